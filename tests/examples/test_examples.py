"""Every example runs, draws its picture, and prints the numbers that are known, and what the README shows of it."""

import math
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from pricing_core.american import price_many
from pricing_core.chains import fit_chain, read_chain
from pricing_core.chains.side_files import read_dividends
from tests.problems.control_problems import lowered_cart

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PNG = b"\x89PNG"
HEADLINES = {
    "relay": ["theorem 11.6 holds: well-posed", "origin reached at t = 2.000000000000"],
    "friction": ["end at 3.141593, 6.283185, 9.424778", "sticks at q = 0.700000000000", "u = 0.700000000000"],
    # sqrt(2/g) to the floor, (1 + e)/(1 - e) times as long to rest, 1 - e^2 of the energy lost.
    "bouncing_ball": [
        "first impact at t = 0.451523640986, 5.003100000 of 9.810000000 lost",
        "at rest from t = 2.558633965586 on, each bounce 0.700000000 of",
        "bears u = 9.810000000000",
    ],
    "pendulum": [
        "first impact at t = 0.551: a quarter of the period is 0.5508",
        "swing 3 reaches 0.587: 0.5866",
    ],
    "oligopoly": [
        "30.000 and earns  1050.00",
        "25.000 and earns   625.00",
        "0.000 and earns     0.00",
        "price 45.000",
    ],
    "optimal_control": [
        "cost 13.521466835  (solved",
        "reaches the floor at 1.954759358",
        "an atom of 2.889872101 at 1.954759358",
    ],
    # Laws of textbooks, each held against what is found; see the script.
    "converters": [
        "law    4.800000000   within 1e-11",
        "law   -2.400000000   within 1e-10",
        "law   -8.000000000   within 0.001",
    ],
    # 10 minutes late, 2 minutes of slack an hour; 60 + 56 minutes for two trains.
    "railway_timetable": ["shortest period 58 minutes, set by west and east", "for 5 hours"],
    # 5 + 7 + 3 + 3 = 18 minutes for each pallet, 6 at the drill.
    "production_line": ["      1                 18  saw -> drill", "with three pallets: 10"],
}
PERIOD = 0.02  # Period of the rectified mains, in seconds.


def printed_by(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return capsys.readouterr().out


def without_errors(text: str) -> list[str]:
    """Return the lines without the stated errors, which any change of the engine may change."""
    return [re.sub(r"\+- [\d.e+-]+", "+-", line).strip() for line in text.splitlines()]


@pytest.mark.parametrize("name", ["price_one", "dividends_and_curves"])
def test_an_example_prints_what_the_readme_shows(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    printed = without_errors(printed_by(name, capsys))
    shown = without_errors((ROOT / "README.md").read_text(encoding="utf-8"))
    start = shown.index(printed[0])
    assert shown[start : start + len(printed)] == printed


@pytest.mark.parametrize("name", HEADLINES)
def test_an_example_has_its_headlines_and_its_picture(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    picture = EXAMPLES / "out" / f"{name}.png"
    picture.unlink(missing_ok=True)
    printed = printed_by(name, capsys)
    for headline in HEADLINES[name]:
        assert headline in printed
    assert picture.read_bytes().startswith(PNG)
    assert picture.stat().st_size > 10_000


def test_the_headlines_of_optimal_control_are_those_of_the_closed_form() -> None:
    known = lowered_cart(sigma=2.8898721012, junction=1.9547593576, T=4.0)
    assert known.problem.x0 == pytest.approx([2.0, 0.0], abs=1e-9)
    assert known.cost == pytest.approx(13.521466835, abs=1e-8)


def test_the_rectifier_prints_its_output_and_ripple(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """C v' = max(0, |17 sin| - v)/R - v/100, integrated by an ordinary solver."""

    def slope(t: float, v: list[float]) -> list[float]:
        charge = max(0.0, abs(17.0 * math.sin(100.0 * math.pi * t)) - v[0]) / 0.5
        return [(charge - v[0] / 100.0) / 1e-3]

    t = np.linspace(0.18, 0.2, 4001)
    settled = solve_ivp(slope, (0.0, 0.2), [0.0], t_eval=t, max_step=1e-4, rtol=1e-9, atol=1e-11).y[0]
    monkeypatch.setattr(sys, "argv", ["rectifier.py", str(tmp_path)])
    printed = printed_by("rectifier", capsys)
    mean, ripple = (float(number) for number in re.findall(r"([\d.]+) V", printed))
    assert (mean, ripple) == (16.1029, 1.3098)
    assert ripple == pytest.approx(np.ptp(settled), abs=1e-4)
    assert mean == pytest.approx(trapezoid(settled, t) / PERIOD, abs=1e-4)
    assert (tmp_path / "rectifier.png").stat().st_size > 10_000


def test_the_scenarios_of_a_book_and_its_day_have_their_headlines(capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(EXAMPLES / "scenarios.py"))
    crash, day = example["main"](300)
    assert crash == pytest.approx(497_000.0, abs=500.0)
    assert day["profit_and_loss"] == pytest.approx(15_420.0, abs=20.0)
    assert sum(day[name] for name in example["PARTS"]) == pytest.approx(day["profit_and_loss"], rel=1e-9)
    assert abs(day["residual"]) < 0.01 * sum(abs(day[name]) for name in example["PARTS"])
    assert "1500 rows" in capsys.readouterr().out
    # The same by hand.
    book, _ = example["book_of"](300)
    terms = (
        "option_type",
        "strike",
        "dividend_yield",
        "spot",
        "expiry",
        "rate",
        "volatility",
        "cash_dividends",
    )
    columns = {name: book[name].to_pylist() for name in terms}
    moved = columns | {
        "spot": np.multiply(columns["spot"], 0.8),
        "volatility": np.add(columns["volatility"], 0.15),
        "rate": np.subtract(columns["rate"], 0.005),
    }
    profit = price_many(moved, tolerance=1e-5)["price"] - price_many(columns, tolerance=1e-5)["price"]
    assert crash == pytest.approx(100.0 * profit @ np.array(book["quantity"]), rel=1e-9)


def test_the_file_of_quotes_is_one_that_is_fitted(capsys, monkeypatch, tmp_path):
    names = runpy.run_path(str(EXAMPLES / "chain" / "make_quotes.py"))
    monkeypatch.setitem(names["main"].__globals__, "OUT", tmp_path)
    names["main"]()
    assert capsys.readouterr().out.startswith("216 quotes in ")
    quotes = read_chain(tmp_path / "quotes.csv")
    fit = fit_chain(quotes, names["RATE"], cash_dividends=read_dividends(str(tmp_path / "dividends.csv")))
    off = np.abs(fit.carry["dividend_yield"].to_numpy() - names["DIVIDEND_YIELD"])
    assert np.all(off < 3.0 * fit.carry["standard_error"].to_numpy())  # prices are rounded to cents
    assert np.all(off[2:] < 1e-4)
    assert fit.flags == {"one_sided": 4, "crossed": 3}
    assert fit.share_within_after >= 0.99
