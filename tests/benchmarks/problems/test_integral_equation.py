import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.problems.classic_sets import BOUNDARY_TIMES, classic_problems
from benchmarks.problems.integral_equation import put_values, solve_put_boundary
from pricing_core.american import Market

DATA = Path(__file__).parents[2] / "data"
OWN_ERROR = 1e-9  # as a fraction of the strike


def rows(name: str) -> Iterator[dict[str, str]]:
    with (DATA / name).open() as file:
        yield from csv.DictReader(line for line in file if not line.startswith("#"))


def puts() -> Iterator[tuple[Market, float, float, float, float]]:
    """Yield (market, expiry, spot/strike, price/strike, its error); calls as puts with everything exchanged."""
    for row in rows("american_true_values.csv"):
        strike, spot, price = (float(row[name]) for name in ("strike", "spot", "price"))
        rate, dividend_yield = float(row["rate"]), float(row["dividend_yield"])
        error = float(row["reference_error"])
        if row["option_type"] == "call":
            error *= strike / spot
            strike, spot, rate, dividend_yield = spot, strike, dividend_yield, rate
        market = Market(1.0, rate, float(row["volatility"]), dividend_yield)
        yield market, float(row["expiry"]), spot / strike, price / strike, error


def test_prices_are_the_tabulated_ones_to_their_last_digit() -> None:
    compared = 0
    for market, expiry, spot, price, error in puts():
        boundary = solve_put_boundary(market, expiry)
        if spot > boundary.at(np.array([expiry]))[0]:
            found = put_values(boundary, np.array([spot])).value[0]
            assert found == pytest.approx(price, rel=0.0, abs=error + OWN_ERROR)
            compared += 1
    assert compared >= 80


def test_boundaries_are_the_tabulated_ones_to_their_accuracy() -> None:
    for row in rows("exercise_boundaries.csv"):
        market = Market(1.0, float(row["rate"]), float(row["volatility"]), float(row["dividend_yield"]))
        found = solve_put_boundary(market, float(row["expiry"])).at(np.array([float(row["time_to_expiry"])]))
        strike, tabulated = float(row["strike"]), float(row["boundary"])
        error = (
            2.0 * float(row["reference_error"]) + 1e-6 * strike
        )  # the table's is its last change, no bound
        assert strike * found[0] == pytest.approx(tabulated, rel=0.0, abs=error)


def test_delta_and_gamma_are_the_derivatives_of_the_value() -> None:
    boundary = solve_put_boundary(Market(1.0, 0.05, 0.25, 0.03), 1.0)
    spots, h = np.array([0.85, 1.0, 1.2]), 1e-4
    below, here, above = (put_values(boundary, spots + shift) for shift in (-h, 0.0, h))
    assert here.delta == pytest.approx((above.value - below.value) / (2 * h), abs=1e-7)
    assert here.gamma == pytest.approx((above.delta - below.delta) / (2 * h), abs=1e-6)


@pytest.mark.parametrize("name", ["ALO", "Ju call 1"])
def test_value_and_slope_meet_the_payoff_at_the_boundary(name: str) -> None:
    (problem,) = classic_problems((name,))
    sign = -1.0 if problem.option.is_put else 1.0
    assert np.all(problem.true.price > sign * (problem.spots - 1.0))
    assert np.all(np.abs(problem.true.delta) < 1.0)
    assert np.all(np.diff(sign * problem.true.boundary) > 0.0)  # away from the strike as time to expiry grows
    assert problem.true.boundary.shape == (len(BOUNDARY_TIMES),)


def test_a_call_s_values_are_those_of_the_put_with_everything_exchanged() -> None:
    (problem,) = classic_problems(("Ju call 2",))
    mirrored = Market(1.0, problem.market.dividend_yield, problem.market.volatility, problem.market.rate)
    boundary = solve_put_boundary(mirrored, problem.option.expiry)
    h = 1e-4

    def call(spots: np.ndarray) -> np.ndarray:
        return np.asarray(spots * put_values(boundary, 1.0 / spots).value)

    below, here, above = (call(problem.spots + shift) for shift in (-h, 0.0, h))
    assert problem.true.price == pytest.approx(here, abs=1e-12)
    assert problem.true.delta == pytest.approx((above - below) / (2 * h), abs=1e-7)
    assert problem.true.gamma == pytest.approx((above - 2 * here + below) / h**2, abs=1e-5)


def test_only_spots_at_which_the_option_is_held_are_compared() -> None:
    (a, c) = classic_problems(("A", "C"))
    assert a.spots.tolist() == [0.9, 1.0, 1.1, 1.2]  # 0.8 is exercised
    assert np.isnan(c.true.gamma).tolist() == [
        True,
        False,
        False,
        False,
        False,
    ]  # 0.9 is next to the boundary
