"""What the examples print is what the README shows, and some is found otherwise; `make examples` runs them all."""

import ast
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from pricing_core.american import price_many
from pricing_core.chains import fit_chain, read_chain
from pricing_core.chains.side_files import read_dividends
from tests.problems.control_problems import lowered_cart
from tests.problems.needs_kernel import needs_kernel

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
SCRIPTS = sorted(EXAMPLES.glob("[0-9][0-9]_*.py"))


def printed_by(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return capsys.readouterr().out


def without_errors(text: str) -> list[str]:
    """Return the lines without the stated errors, which any change of the engine may change."""
    return [re.sub(r"\+- [\d.e+-]+", "+-", line).strip() for line in text.splitlines()]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_says_what_it_shows_and_asserts_it(script: Path) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    says = ast.get_docstring(tree) or ""
    assert says.splitlines()[0].endswith(".")
    assert says.endswith(f"Run it from the root of the project: .venv/bin/python examples/{script.name}")
    assert any(isinstance(node, ast.Assert) or _ends_the_run(node) for node in ast.walk(tree))


def _ends_the_run(node: ast.AST) -> bool:
    return isinstance(node, ast.Raise) and "SystemExit" in ast.dump(node)


def test_the_examples_are_numbered_without_a_gap() -> None:
    assert [int(script.stem[:2]) for script in SCRIPTS] == list(range(1, len(SCRIPTS) + 1))
    assert len(SCRIPTS) >= 16


@needs_kernel
def test_an_example_that_fails_fails_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main = runpy.run_path(str(EXAMPLES / "run_all.py"))["main"]
    (tmp_path / "01_holds.py").write_text("print('yes')")
    (tmp_path / "02_fails.py").write_text("print('no')\nassert 1 + 1 == 3")
    main.__globals__.update(HERE=tmp_path, OUT=tmp_path / "out")
    assert main() == 1
    assert "1 of 2 examples" in (shown := capsys.readouterr()).out
    assert "AssertionError" in shown.err
    assert (tmp_path / "out" / "02_fails.txt").read_text() == "no\n"


def test_an_example_prints_what_the_readme_shows(capsys: pytest.CaptureFixture[str]) -> None:
    printed = without_errors(printed_by("01_first_put", capsys))
    shown = without_errors((ROOT / "README.md").read_text(encoding="utf-8"))
    start = shown.index(printed[0])
    assert shown[start : start + len(printed)] == printed


def test_the_headlines_of_optimal_control_are_those_of_the_closed_form() -> None:
    known = lowered_cart(sigma=2.8898721012, junction=1.9547593576, T=4.0)
    assert known.problem.x0 == pytest.approx([2.0, 0.0], abs=1e-9)
    assert known.cost == pytest.approx(13.521466835, abs=1e-8)


def test_the_scenarios_of_a_book_and_its_day_have_their_headlines(capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(EXAMPLES / "09_scenarios.py"))
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


@pytest.mark.nightly
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


def test_the_readme_is_short_and_narrow() -> None:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 150
    assert max(map(len, lines)) < 120
