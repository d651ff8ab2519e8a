"""Contracts as obstacle problems: beside the engines, known values, and the problems of bumped contracts."""

import numpy as np
import pytest

from pricing_core.american import LocalVolatility, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.differences import plan_directions
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.american.engines.solve import solve as solve_book
from pricing_core.obstacle import solve
from pricing_core.obstacle.adjoint import Walk
from pricing_core.obstacle.direction import Neighbours
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.march import march
from pricing_core.obstacle.solution import march_again
from tests.problems.needs_kernel import needs_kernel
from tests.problems.schedules import CONTRACTS


def value_of(option, market, tolerance=1e-6):
    """Return the price and its error estimate, money."""
    book = Book.of([(option, market)])
    found = solve(contract_problem(book), place_of(book), tolerance)
    return option.strike * found.value, option.strike * found.error_estimate


@needs_kernel
@pytest.mark.parametrize("name", CONTRACTS)
def test_the_value_is_that_of_the_engines(name):
    contract = CONTRACTS[name]
    found, error = value_of(*contract)
    other = solve_book(Book.of([contract]), Request(np.array([1e-8]), "none"))
    assert abs(found - other.value[0]) <= 2.0 * error + other.error[0]
    assert abs(found - other.value[0]) <= 1e-4


@pytest.mark.parametrize(
    ("forward", "shift", "volatility", "rate", "expiry", "value"),
    [(100.0, -30.0, 0.25, 0.05, 0.5, 4.8320475), (110.0, -50.0, 0.5, 0.08, 1.0, 6.1446248)],
)
def test_a_local_volatility_has_the_value_of_displaced_diffusion(
    forward, shift, volatility, rate, expiry, value
):
    spots = forward * np.exp(np.linspace(-3.0, 3.0, 200))
    surface = LocalVolatility(
        [0.0], spots, [np.minimum(volatility * np.maximum(spots + shift, 0.0) / spots, 15.0)]
    )
    found, error = value_of(Option("put", 100.0, expiry), Market(forward, rate, surface, rate))
    assert found == pytest.approx(value, abs=error + 1e-6)


def test_an_escrowed_call_waits_for_a_large_dividend():
    """.8991 by a tree and by the chapter's road (references, next to the boundary, case 1)."""
    dividends = [{"time": 0.02, "amount": 1.0}, {"time": 0.06, "amount": 20.0}]
    market = Market(100.0, 0.03, 0.15, cash_dividends=dividends, dividend_model="escrowed")
    found, error = value_of(Option("call", 100.0, 0.08), market)
    assert found == pytest.approx(0.8991, abs=5e-5 + error)


def test_a_put_waits_for_a_dividend_larger_than_the_spot():
    """It is worth at least the strike paid at the dividend (references, next to the boundary, case 4)."""
    market = Market(
        1.0603778471,
        0.053223223,
        0.1109076699,
        0.0386771411,
        cash_dividends=[{"time": 0.1981747164, "amount": 42.3857777787}],
    )
    found, error = value_of(Option("put", 100.0, 0.3625585944), market, 1e-6)
    assert found >= 100.0 * np.exp(-0.053223223 * 0.1981747164) - error


@pytest.mark.parametrize(
    "name", ["put, quarterly dividends", "put, curves", "put, escrowed", "call, escrowed", "put, window"]
)
def test_derivatives_by_bumped_contracts_are_differences_of_marches(name):
    book = Book.of([CONTRACTS[name]])
    problem, place = contract_problem(book), place_of(book)
    grid = Grid.of(choose_map(problem, np.array([place])), 4)
    found = march(problem, grid)
    walk, slope = Walk.of(found, place), found.now.derivatives(np.array([place]))[1, 0]
    for planned in plan_directions(book, extended=False):
        places = [place_of(side) for side in planned.sides]
        sides = Neighbours(*map(contract_problem, planned.sides), planned.step)
        derivative = walk.derivative(sides) + slope * sides.difference(*places)
        values = [
            march_again(side, found).now(np.array([x]))[0] for side, x in zip(sides.both, places, strict=True)
        ]
        assert derivative == pytest.approx(sides.difference(*values), rel=3e-3, abs=3e-4), planned.kind
