"""Puts with a negative yield before cash dividends: their contact set begins between two spots and has a far end."""

import numpy as np
import pytest

from pricing_core.american import contract_from, price_many
from pricing_core.american.book.book import Book
from pricing_core.american.engines.multiplier_collocation.levels import solve_at_level, solve_to_tolerance
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
COLLOCATED = "multiplier-collocation"


def random_puts(seed, count, overhang=(-4.3, -1.3), volatility=(0.1, 0.5), **fixed):
    """Return puts with one to five dividends; their yields range over orders of magnitude."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(count):
        paid = int(rng.integers(1, 6))
        expiry, spot = rng.uniform(0.2, 2.5), rng.uniform(60.0, 130.0)
        times = (np.arange(paid) + rng.uniform(0.1, 0.9, paid)) * expiry / paid
        dividends = [{"time": t, "amount": spot * rng.uniform(0.002, 0.03)} for t in times.tolist()]
        rows.append(
            {
                "option_type": "put",
                "spot": spot,
                "strike": 100.0,
                "expiry": expiry,
                "rate": rng.uniform(0.005, 0.08),
                "dividend_yield": -(10.0 ** rng.uniform(*overhang)),
                "volatility": rng.uniform(*volatility),
                "cash_dividends": dividends,
                **fixed,
            }
        )
    return rows


def table(rows, **options):
    return price_many({name: [row[name] for row in rows] for name in rows[0]}, **options)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("model", ["spot", "escrowed"])
def test_values_are_those_of_the_march_of_obstacle_problems(model, tolerance):
    rows = random_puts(11, 40, dividend_model=model)
    found = table(rows, tolerance=tolerance, greeks="none")
    general = table(rows, tolerance=max(0.3 * tolerance, 1e-6), greeks="none", method="lcs")
    assert np.mean(found["method"] == COLLOCATED) >= 0.9
    assert (found["status"] == "ok").all()
    distance = np.abs(found["price"] - general["price"])
    assert (distance <= found["error_estimate"] + general["error_estimate"]).all()


def test_whatever_the_yield_the_value_is_continuous_in_it():
    """Where the far end begins to be followed nothing jumps by more than both estimates, and what the yield brings."""
    yields = -np.geomspace(1e-5, 1e-2, 40)
    row = random_puts(3, 1, volatility=(0.25, 0.3))[0]
    rows = [{**row, "dividend_yield": q} for q in yields.tolist()]
    found = table(rows, tolerance=1e-7, greeks="standard")
    assert (found["method"] == COLLOCATED).all()
    slope = found["dividend_rho"]
    for k in range(len(rows) - 1):
        step = yields[k + 1] - yields[k]
        expected = 0.5 * (slope[k] + slope[k + 1]) * step
        allowed = found["error_estimate"][k] + found["error_estimate"][k + 1] + 100.0 * step**2
        assert abs(found["price"][k + 1] - found["price"][k] - expected) <= allowed


def test_the_derivatives_are_those_of_the_value():
    rows = random_puts(5, 12, overhang=(-2.3, -1.5), volatility=(0.2, 0.5))
    levels = np.full(len(rows), 5, dtype=np.int64)
    found = table(rows, tolerance=1e-7, greeks="standard", greek_errors=True)
    for name, field in (("vega", "volatility"), ("rho", "rate"), ("dividend_rho", "dividend_yield")):
        bumped = []
        for h in (1e-3, 2e-3):
            ends = []
            for sign in (1.0, -1.0):
                moved = [contract_from({**row, field: row[field] + sign * h}) for row in rows]
                found_there = solve_at_level(Book.of(moved), levels, 1)
                ends.append(np.where(found_there.settled, found_there.numbers[0], np.nan))
            bumped.append(100.0 * (ends[0] - ends[1]) / (2.0 * h))
        known = (4.0 * bumped[0] - bumped[1]) / 3.0
        own = np.abs(bumped[0] - bumped[1]) + 1e-3
        here = (found["method"] == COLLOCATED) & np.isfinite(known)
        assert here.sum() >= 9
        distance = np.abs(found[name] - known)[here]
        assert (distance <= (found[f"{name}_error"] + own)[here]).all()


def test_a_spot_below_the_far_end_is_held():
    """Between its onset and its arrival at a spot of zero the contact set has a far end: smaller spots are held."""
    row = {
        "option_type": "put",
        "strike": 100.0,
        "expiry": 1.0,
        "rate": 0.03,
        "dividend_yield": -0.03,
        "volatility": 0.15,
        "cash_dividends": [{"time": 0.35, "amount": 1.5}],
    }
    spots = np.linspace(30.0, 110.0, 41)
    found = table([{**row, "spot": spot} for spot in spots.tolist()], tolerance=1e-6, greeks="none")
    general = table(
        [{**row, "spot": spot} for spot in spots.tolist()], tolerance=1e-6, greeks="none", method="lcs"
    )
    distance = np.abs(found["price"] - general["price"])
    assert (distance <= found["error_estimate"] + general["error_estimate"]).all()
    intrinsic = 100.0 - spots
    held = found["price"] > intrinsic + 1e-3
    exercised = found["price"] <= intrinsic + 1e-9
    assert held[0]
    assert exercised.any()
    assert held[-1]
    far, near = spots[exercised][[0, -1]]
    assert (exercised == ((spots >= far) & (spots <= near))).all()


@pytest.mark.nightly
def test_a_value_that_is_not_collocated_well_says_so():
    """Where the spots that a dividend takes whole are within reach, the estimate covers what is neglected."""
    rows = random_puts(7, 40, volatility=(0.5, 0.9))
    found = solve_to_tolerance(Book.of([contract_from(row) for row in rows]), np.full(40, 1e-5), 1)
    general = table(rows, tolerance=1e-6, greeks="none", method="lcs")
    distance = np.abs(found.value - general["price"] / 100.0)[found.settled]
    assert (distance <= (found.error + general["error_estimate"] / 100.0)[found.settled]).all()


@pytest.mark.nightly
@pytest.mark.parametrize(("volatility", "least"), [((0.35, 0.6), 0.9), ((0.9, 1.5), 0.3)])
def test_segments_over_which_the_spot_spreads_far_are_cut(volatility, least):
    rows = random_puts(7, 40, volatility=volatility)
    book = Book.of([contract_from(row) for row in rows])
    spread = book.segments.volatility * np.sqrt(book.segments.duration)
    wide = np.maximum.reduceat(spread, book.first[:-1]) > 0.4
    assert wide.sum() >= 10
    found = solve_to_tolerance(book, np.full(40, 1e-6), 1)
    met = found.settled & (found.error <= 1e-6)
    assert met[wide].mean() >= least
    general = table(rows, tolerance=3e-7, greeks="none", method="lcs")
    distance = np.abs(found.value - general["price"] / 100.0)
    assert (distance <= found.error + general["error_estimate"] / 100.0)[met].all()


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["cash", "proportional"])
def test_a_small_dividend_next_to_a_larger_one_changes_little(kind):
    """What is waited for may be paid a few events later, and a contact set with two ends may go on through an event."""
    random, rows = np.random.default_rng(5), random_puts(5, 40, volatility=(0.1, 0.9))
    for row in rows:
        time = float(random.uniform(0.02, 0.98) * row["expiry"])
        size = float(10.0 ** random.uniform(-4.0, -0.5))
        small = {"time": time, "amount": size} if kind == "cash" else {"time": time, "fraction": 0.1 * size}
        row["proportional_dividends"] = [small] if kind == "proportional" else []
        dividends = [*row["cash_dividends"], *([small] if kind == "cash" else [])]
        row["cash_dividends"] = sorted(dividends, key=lambda each: each["time"])
    found = solve_to_tolerance(Book.of([contract_from(row) for row in rows]), np.full(40, 1e-6), 1)
    met = found.settled & (found.error <= 1e-6)
    assert met.mean() >= 0.6
    general = table(rows, tolerance=1e-6, greeks="none", method="lcs")
    distance = np.abs(found.value - general["price"] / 100.0)
    assert (distance <= found.error + general["error_estimate"] / 100.0)[met].all()


@pytest.mark.parametrize(
    ("spot", "expiry", "rate", "dividend_yield", "volatility", "cash", "proportional", "price"),
    [
        (113.0, 0.403, 4.74e-4, -0.242, 1.53, [(0.233, 0.00167), (0.31, 1.44e-4), (0.401, 0.643)], [], None),
        (120.0, 1.8, 0.029, -0.063, 0.27, [(1.1, 6.6), (1.4, 1.3)], [(1.3, 8.7e-4)], 5.83125),
        (220.0, 5.1, 1.3e-4, -0.12, 0.28, [(4.0, 1.7)], [(2.9, 1.3e-4)], 0.76744),
    ],
)
def test_known_contracts_with_two_events_in_a_row(
    spot, expiry, rate, dividend_yield, volatility, cash, proportional, price
):
    row = {
        "option_type": "put",
        "spot": spot,
        "strike": 100.0,
        "expiry": expiry,
        "rate": rate,
        "dividend_yield": dividend_yield,
        "volatility": volatility,
        "cash_dividends": [{"time": t, "amount": a} for t, a in cash],
        "proportional_dividends": [{"time": t, "fraction": f} for t, f in proportional],
    }
    found, general = (table([row], tolerance=1e-6, greeks="none", method=m) for m in ("auto", "lcs"))
    doubt = found["error_estimate"] + general["error_estimate"]
    assert np.abs(found["price"] - general["price"]) <= doubt
    if price is not None:
        assert found["price"][0] == pytest.approx(price, abs=2e-4)


def test_what_reaches_to_spots_that_a_dividend_takes_whole_is_left_to_the_general_path():
    row = {
        "option_type": "put",
        "spot": 20.0,
        "strike": 100.0,
        "expiry": 2.0,
        "rate": 0.01,
        "volatility": 0.45,
    }
    paid = {"dividend_yield": -0.03, "cash_dividends": [{"time": 2.0, "amount": 10.0}]}
    found = table([{**row, **paid}], tolerance=1e-6, greeks="none")
    assert found["method"][0] != COLLOCATED
    assert found["status"][0] == "ok"


def test_a_contact_set_near_the_strike_is_not_lost_to_one_that_comes_from_far():
    """Before a small dividend, at a low rate, both exist apart; which comes first depends on the volatility."""
    rng, rows = np.random.default_rng(4), []
    paid = [(0.6202, 1.3032), (1.1797, 1.7418), (1.9771, 0.2617), (2.3444, 1.565)]
    fixed = {
        **random_puts(4, 1)[0],
        "expiry": 2.8268,
        "rate": 0.01329,
        "dividend_yield": -0.02945,
        "cash_dividends": [{"time": time, "amount": amount} for time, amount in paid],
    }
    for volatility in np.linspace(0.405, 0.446, 12).tolist():
        rows.append({**fixed, "spot": rng.uniform(80.0, 120.0), "volatility": volatility})
    found = table(rows, tolerance=1e-6, greeks="none")
    general = table(rows, tolerance=1e-5, greeks="none", method="lcs")
    assert np.mean(found["method"] == COLLOCATED) > 0.3
    distance = np.abs(found["price"] - general["price"])
    assert (distance <= found["error_estimate"] + general["error_estimate"]).all()
