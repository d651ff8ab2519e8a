"""The engine of the march: beside the other engines, next to the boundary, local volatilities, interrupts."""

import numpy as np
import pytest

from pricing_core.american import LocalVolatility, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, error_of
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from pricing_core.american.engines.obstacle_march.contact_ends import exercise_begins
from pricing_core.american.engines.solve import boundary_of, solve
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel
from tests.problems.nightly import nightly
from tests.problems.schedules import CONTRACTS

ENGINE = ObstacleMarch()
BY_DAY = ["put, half the spot", "call, fraction and amount on one date"]
SURFACE = LocalVolatility(
    [0.0, 0.5, 1.0], [60.0, 80.0, 100.0, 130.0], [[0.4, 0.3, 0.25, 0.22], [0.35, 0.3, 0.26, 0.24], [0.3] * 4]
)


@needs_kernel
@pytest.mark.parametrize("name", [*BY_DAY, *nightly(name for name in CONTRACTS if name not in BY_DAY)])
def test_the_greeks_are_those_of_the_other_engines(name):
    found = solved(ENGINE, CONTRACTS[name], tolerance=1e-5, greeks="extended")
    other = solve(Book.of([CONTRACTS[name]]), Request(np.array([1e-8]), "extended"))
    assert found.status[0] == "ok"
    assert found.complete[0]
    assert found.european[0] == pytest.approx(other.european[0], abs=1e-4)
    for greek in GREEKS:
        if greek != "delta_sticky_moneyness":
            error = getattr(found, error_of(greek))[0] + getattr(other, error_of(greek))[0]
            assert abs(getattr(found, greek)[0] - getattr(other, greek)[0]) <= error, greek
    for greek in GREEK_LISTS:
        mine, its = getattr(found, greek).values, getattr(other, greek).values
        assert np.allclose(mine, its, rtol=1e-3, atol=1e-2), greek


@pytest.mark.parametrize(
    ("spot", "theta", "gamma"), [(82.2, -0.0083, 0.04438), (82.5, -0.0555, 0.04392), (84.0, -0.2883, 0.04174)]
)
def test_theta_and_gamma_next_to_the_boundary_with_a_dividend_to_come(spot, theta, gamma):
    """Differences of an independent march's prices (references, next to the boundary, case 2)."""
    market = Market(spot, 0.06, 0.2, cash_dividends=[{"time": 0.5, "amount": 0.2}])
    found = solved(ENGINE, (Option("put", 100.0, 1.0), market))
    assert found.theta[0] == pytest.approx(theta, abs=max(4e-4, found.theta_error[0]))
    assert found.theta_error[0] < 2e-3
    assert found.gamma[0] == pytest.approx(gamma, abs=2e-5)


def test_a_put_beyond_a_boundary_that_two_engines_put_elsewhere_is_held():
    """73.42028, not exercised, boundary 26.16 (references, next to the boundary, case 3)."""
    market = Market(26.58404959, 0.0237627188, 0.0813081456, 0.0866609149)
    found = solved(ENGINE, (Option("put", 100.0, 3.6466938629), market), tolerance=1e-7)
    assert not found.exercised[0]
    assert found.value[0] == pytest.approx(73.42028, abs=1e-5)
    assert found.boundary[0] == pytest.approx(26.16, abs=0.01)


def test_a_boundary_next_to_the_end_of_the_grid_is_looked_for_further_out():
    """58.18447 by the march of the premium; the grid around the spot ends at 59.95, where its rule holds the payoff."""
    market = Market(108.14, 0.0664, 0.1941, 0.1072)
    found = solved(ENGINE, (Option("put", 100.0, 0.2877), market))
    assert found.boundary[0] == pytest.approx(58.18, rel=2e-3)
    assert abs(found.boundary[0] - 58.18) <= found.boundary_error[0] + 0.01


def test_steps_begin_anew_where_exercise_begins_to_earn():
    book = Book.of([CONTRACTS["put, rate turns positive"], CONTRACTS["put, curves"]])
    assert exercise_begins(book.part(slice(0, 1))) == (0.5,)
    assert exercise_begins(book.part(slice(1, 2))) == ()


@pytest.mark.parametrize("spot", [0.32732, 100.0, 108.24])
def test_a_boundary_does_not_depend_on_the_spot(spot):
    """.2184 (references, next to the boundary, case 5)."""
    market = Market(
        spot, 0.0208092056, 0.1424944, cash_dividends=[{"time": 0.1050864595, "amount": 4.6705494924}]
    )
    book = Book.of([(Option("put", 100.0, 0.2266575854), market)])
    found = ENGINE.boundary(book, Request(np.array([1e-6])))(np.zeros(1))
    assert found.near[0] == pytest.approx(0.2184, rel=2e-3) or np.isnan(found.near[0])


@needs_kernel
def test_boundaries_are_those_of_the_march_of_the_premium():
    book = Book.of([(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2))])
    times, request = np.array([0.0, 0.3, 0.75, 0.9, 0.99, 1.0]), Request(np.array([1e-7]))
    found = ENGINE.boundary(book, request)(times)
    other = boundary_of(book, Request(np.array([1e-8])))(times)
    assert found.near == pytest.approx(other.near, rel=1e-4)
    assert (np.abs(found.near - other.near) <= 3.0 * found.error + 1e-9).all()


def test_a_surface_that_moves_with_the_spot_has_its_own_delta():
    option, spot = Option("put", 100.0, 1.0), 98.0
    found = solved(ENGINE, (option, Market(spot, 0.05, SURFACE)), tolerance=1e-5, greeks="standard")
    sides = [
        solved(ENGINE, (option, Market(factor * spot, 0.05, SURFACE.moved(factor))), tolerance=3e-6).value[0]
        for factor in (1.01, 0.99)
    ]
    assert found.delta_sticky_moneyness[0] == pytest.approx((sides[0] - sides[1]) / (0.02 * spot), abs=4e-4)
    assert found.message[0] == ""


def test_a_row_that_cannot_be_priced_costs_the_others_nothing():
    wild = (
        Option("call", 100.0, 200.0, "european"),
        Market(100.0, 0.05, LocalVolatility([0], [100], [[15.0]])),
    )
    plain = (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2))
    book = Book.of([wild, plain])
    found = ENGINE.solve(book, Request(np.full(2, 1e-4), "none"))
    alone = ENGINE.solve(Book.of([plain]), Request(np.array([1e-4]), "none"))
    assert found.status[1] == "ok"
    assert found.value[1] == alone.value[0]
    assert found.status[0] == "out_of_domain" or found.error[0] > 0.0


def test_an_interrupt_ends_the_work_with_what_is_known():
    contract = (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2))
    asked = []
    found = ENGINE.solve(
        Book.of([contract, contract]),
        Request(np.full(2, 1e-9), "standard", interrupt=lambda: len(asked) > 60 or asked.append(0)),
    )
    assert found.status.tolist() == ["deadline", "deadline"]
    assert np.isfinite(found.value[0])
    assert np.isnan(found.value[1])


def test_contracts_that_differ_in_the_spot_share_a_march():
    option, spots = Option("put", 100.0, 1.0), (85.0, 100.0)
    book = Book.of([(option, Market(spot, 0.05, SURFACE)) for spot in spots])
    shared, alone = (
        ENGINE.solve(book, Request(np.full(2, 1e-4), "standard", share_solves=share))
        for share in (True, False)
    )
    assert (shared.status == "ok").all()
    assert len(set(shared.steps.tolist())) == 1
    assert (np.abs(shared.value - alone.value) <= shared.error + alone.error).all()
    assert shared.delta == pytest.approx(alone.delta, abs=1e-4)
    assert shared.vega == pytest.approx(alone.vega, rel=2e-3)
