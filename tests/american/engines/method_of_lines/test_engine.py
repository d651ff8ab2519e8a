"""The method of lines as an engine: Greeks, interrupts, what fails, and both boundaries."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.problems.random_contracts import flat, two_boundaries, two_boundaries_with_cash
from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    contract_from,
    price,
)
from pricing_core.american.book.book import Book
from pricing_core.american.engines.closed_form import ClosedForm
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.method_of_lines import MethodOfLines, Resolution, refinement
from pricing_core.american.engines.obstacle_march import CompiledMarch
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel

ENGINE = MethodOfLines()
PUT = Option("put", 100.0, 1.0)
CURVE = PiecewiseConstant([0.4, 1.0], [0.02, 0.06])
CONTRACTS = {
    "two boundaries": (PUT, Market(90.0, -0.005, 0.2, -0.03)),
    "cash dividends": (PUT, Market(100.0, 0.05, 0.25, 0.01, cash_dividends=[CashDividend(0.3, 2.0)])),
    "escrowed dividends": (
        Option("call", 95.0, 1.0),
        Market(100.0, 0.02, 0.25, 0.04, cash_dividends=[CashDividend(0.3, 2.0)], dividend_model="escrowed"),
    ),
    "curves": (PUT, Market(100.0, CURVE, PiecewiseConstant([0.5, 1.0], [0.2, 0.3]), 0.01)),
    "dates": (Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5, 0.75, 1.0)), Market(100.0, 0.05, 0.25)),
}
SLOW_WITHOUT_KERNEL = [name for name in CONTRACTS if name not in ("two boundaries", "dates")]


def value(contract, *, tolerance=1e-6, **changes):
    option, market = contract
    return solved(ENGINE, (option, replace(market, **changes)), tolerance=tolerance).value[0]


def shifted(curve, by):
    return (
        PiecewiseConstant(curve.times, [v + by for v in curve.values])
        if hasattr(curve, "times")
        else curve + by
    )


@pytest.mark.parametrize(
    "name",
    ["two boundaries", "dates", *(pytest.param(name, marks=needs_kernel) for name in SLOW_WITHOUT_KERNEL)],
)
def test_greeks_are_the_derivatives(name):
    contract = _, market = CONTRACTS[name]
    found = solved(ENGINE, contract, tolerance=1e-5, greeks="extended")
    assert found.complete[0]
    S = market.spot
    below, here, above = (value(contract, spot=S + by, tolerance=1e-7) for by in (-1.0, 0.0, 1.0))
    assert found.delta[0] == pytest.approx((above - below) / 2.0, abs=3e-4)
    assert found.gamma[0] == pytest.approx(above - 2.0 * here + below, abs=3e-4)
    for greek, parameter, step in (
        ("vega", "volatility", 0.01),
        ("rho", "rate", 2e-3),
        ("dividend_rho", "dividend_yield", 2e-3),
    ):
        ends = (
            value(contract, **{parameter: shifted(getattr(market, parameter), by)}) for by in (step, -step)
        )
        up, down = ends
        assert getattr(found, greek)[0] == pytest.approx((up - down) / (2.0 * step), abs=0.15), greek
    assert math.isfinite(found.vanna[0] + found.volga[0])
    for parameter, greek in (("rate", "rho"), ("volatility", "vega")):
        buckets = getattr(found, f"{parameter}_buckets").row(0)
        assert len(buckets) == (2 if name == "curves" else 0)
        if buckets:
            assert sum(buckets) == pytest.approx(getattr(found, greek)[0], abs=0.1)
    if market.cash_dividends:
        amounts = ([CashDividend(0.3, 2.0 + by)] for by in (0.05, -0.05))
        up, down = (value(contract, cash_dividends=amount) for amount in amounts)
        assert found.dividend_sensitivities.row(0)[0] == pytest.approx((up - down) / 0.1, abs=2e-3)


@pytest.mark.parametrize("name", CONTRACTS)
def test_theta_is_that_of_the_equation(name):
    """(11.46) where the contract is held: V_t = r V - (r - q) S V_S - sigma**2 S**2/2 V_SS, S what diffuses."""
    contract = CONTRACTS[name]
    found = solved(ENGINE, contract, tolerance=1e-5)
    book = Book.of([contract])
    now, escrow = book.first_segments(), book.escrow_now()
    S, delta, gamma = book.spot - escrow, found.delta, found.gamma
    expected = now.rate * (found.value - escrow * delta) - (now.rate - now.dividend_yield) * S * delta
    expected -= 0.5 * (now.volatility * S) ** 2 * gamma
    assert found.theta[0] == pytest.approx(expected[0], rel=1e-12)


def test_an_exercised_contract_is_the_payoff():
    found = solved(ENGINE, (PUT, Market(60.0, 0.05, 0.2)), greeks="extended")
    assert (found.value[0], found.delta[0], found.gamma[0], found.theta[0]) == (40.0, -1.0, 0.0, 0.0)
    assert (found.vega[0], found.rho[0], found.vanna[0]) == (0.0, 0.0, 0.0)
    assert found.exercised[0]
    assert found.complete[0]


@pytest.mark.parametrize("scheme", ["sdirk2", "implicit-euler", "crank-nicolson"])
@pytest.mark.parametrize("lcp_method", ["tridiagonal", "policy"])
def test_a_resolution_is_solved_as_asked(scheme, lcp_method):
    engine = MethodOfLines(scheme, lcp_method, Resolution(64, 16))
    found = solved(engine, (PUT, Market(100.0, 0.05, 0.2)), tolerance=1e-3)
    assert found.resolution[0] == Resolution(64, 16, scheme=scheme)
    assert (found.solves[0], found.steps[0], found.method[0]) == (2, 16, scheme)
    assert abs(found.value[0] - 6.090371) <= found.error[0]


def test_where_the_european_value_is_known_the_error_is_the_premiums_alone():
    contract = PUT, Market(100.0, 0.05, 0.2)
    found = solved(ENGINE, contract, tolerance=1e-5)
    exact = solved(ClosedForm(), (replace(PUT, exercise="european"), contract[1]))
    assert found.european[0] == exact.value[0]
    dividends = replace(contract[1], cash_dividends=[CashDividend(0.5, 1e-3)])
    assert solved(ENGINE, (PUT, dividends), tolerance=1e-5).solves[0] >= found.solves[0]


def test_what_fails_costs_its_row_alone_and_says_why(monkeypatch):
    from pricing_core.american.engines.method_of_lines import engine  # noqa: PLC0415  # the module, not the class

    make_solver = engine.make_solver

    def fragile(schedule, *arguments):
        if schedule.spot == 91.0:
            raise ZeroDivisionError("a pivot is zero")
        return make_solver(schedule, *arguments)

    monkeypatch.setattr(engine, "make_solver", fragile)
    contracts = [(PUT, Market(spot, 0.05, 0.2)) for spot in (90.0, 91.0, 92.0)]
    found = solved(ENGINE, *contracts, tolerance=1e-3)
    assert found.status.tolist() == ["ok", "out_of_domain", "ok"]
    assert found.message[1] == "a pivot is zero"
    assert np.isnan(found.value).tolist() == [False, True, False]
    assert found.settled.tolist() == [True, False, True]


def test_everything_with_some_life_and_a_spot_is_served():
    book = Book.of(
        [
            *CONTRACTS.values(),
            (PUT, Market(0.0, 0.05, 0.2)),
            (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2)),
        ]
    )
    assert ENGINE.serves(book).tolist() == [*[True] * len(CONTRACTS), False, False]


def test_both_boundaries_are_found_and_do_not_depend_on_the_spot():
    times, request = np.array([0.5, 0.9, 1.0]), Request(np.array([1e-4]))
    option, market = CONTRACTS["two boundaries"]
    near, far = (
        ENGINE.boundary(Book.of([(option, replace(market, spot=s))]), times, request) for s in (90.0, 40.0)
    )
    np.testing.assert_array_equal(near.near, far.near)
    assert near.found.all()
    assert np.all(near.far < near.near)
    assert (near.near[-1], near.far[-1]) == (pytest.approx(100.0), pytest.approx(100.0 / 6.0))
    assert np.isnan(near.error).all()


@needs_kernel
@pytest.mark.parametrize(("spot", "price"), [(20.0, 88.11), (46.88227782239284, 56.682), (85.0, 15.0)])
def test_below_the_spots_of_exercise_a_put_may_wait_for_a_large_dividend(spot, price):
    """Prices by finite differences of V - (K - S) in the spot; just below the boundary the put is exercised."""
    paid = [CashDividend(1.6662977698340915, 13.802671769527018)]
    market = Market(spot, 0.012320316430753878, 0.12021858745533272, -0.0937399650663395, paid)
    found = solved(ENGINE, (Option("put", 100.0, 1.7199364591528923), market), tolerance=1e-6)
    assert found.value[0] == pytest.approx(price, abs=2e-3)
    assert found.value[0] >= found.european[0] - found.error[0]
    assert found.exercised[0] == (spot == 85.0)


@needs_kernel
@pytest.mark.parametrize("kind", [flat, two_boundaries])
def test_just_inside_the_exercise_region_the_value_is_the_payoff(kind):
    """In the cell of the boundary the values of the held side would go on as a parabola above the payoff."""
    random = np.random.default_rng(5)
    contracts = [contract_from(kind(random)) for _ in range(40)]
    boundary = [price(*contract, tolerance=1e-8).exercise_boundary for contract in contracts]
    inside = [
        (option, replace(market, spot=end * (1.0 - share if option.option_type == "put" else 1.0 + share)))
        for (option, market), end in zip(contracts, boundary, strict=True)
        if end is not None
        for share in (1e-3, 5e-3)
    ]
    truth = [price(*contract, tolerance=1e-8) for contract in inside]
    found = solved(ENGINE, *inside, tolerance=1e-6)
    exercised = np.array([valuation.exercise_now for valuation in truth])
    assert exercised.sum() > 30
    error = np.abs(found.value - [valuation.price for valuation in truth])
    assert np.all(error <= found.error + 1e-8)
    assert np.all(found.exercised[exercised] | (error[exercised] <= 1e-5))


@needs_kernel
def test_a_control_takes_out_the_error_of_the_european_value():
    """The same price from coarser grids, with the European value of the march, and whatever Greeks are asked."""
    random = np.random.default_rng(8)
    contracts = [contract_from(two_boundaries_with_cash(random)) for _ in range(12)]
    helped = MethodOfLines(control=CompiledMarch())
    truth = solved(ENGINE, *contracts, tolerance=1e-7)
    alone, found = (solved(engine, *contracts, tolerance=1e-6) for engine in (ENGINE, helped))
    assert np.all(np.abs(found.value - truth.value) <= found.error + truth.error)
    assert np.all(np.abs(found.european - truth.european) <= truth.error)
    assert np.sum(found.solves) < np.sum(alone.solves) - 6
    for greeks in ("standard", "extended"):
        with_greeks = solved(helped, *contracts, tolerance=1e-6, greeks=greeks)
        np.testing.assert_array_equal(with_greeks.value, found.value)
        np.testing.assert_array_equal(with_greeks.error, found.error)


class WithoutVega(CompiledMarch):
    """The march, which knows no vega."""

    def solve(self, book, request):
        """Leave vega out."""
        found = super().solve(book, request)
        return replace(found, vega=np.full(book.count, math.nan))


@needs_kernel
def test_what_a_control_does_not_know_comes_from_the_grid():
    contract = CONTRACTS["cash dividends"]
    alone, helped = (
        solved(engine, contract, tolerance=1e-5, greeks="extended")
        for engine in (ENGINE, MethodOfLines(control=WithoutVega()))
    )
    for greek in ("vega", "volga"):
        found, expected = getattr(helped, greek)[0], getattr(alone, greek)[0]
        stated = getattr(helped, f"{greek}_error")[0] + getattr(alone, f"{greek}_error")[0]
        assert abs(found - expected) <= stated, greek


def test_an_interrupt_leaves_the_european_value_under_a_local_volatility_unknown():
    surface = LocalVolatility([0.0], [80.0, 120.0], [[0.3, 0.2]])
    for volatility, is_known in ((surface, False), (0.25, True)):
        asked = []
        found = solved(
            ENGINE,
            (PUT, Market(100.0, 0.05, volatility)),
            interrupt=lambda asked=asked: bool(asked) or bool(asked.append(0)),
        )
        assert found.status[0] == "deadline"
        assert np.isfinite(found.european[0]) == is_known


def test_a_row_does_not_depend_on_the_others():
    contracts = list(CONTRACTS.values())
    together = solved(ENGINE, *contracts, tolerance=1e-4, greeks="standard")
    for row, contract in enumerate(contracts):
        alone = solved(ENGINE, contract, tolerance=1e-4, greeks="standard")
        for name in ("value", "error", "delta", "vega", "rho", "boundary", "solves"):
            np.testing.assert_array_equal(getattr(together, name)[row], getattr(alone, name)[0], err_msg=name)


@needs_kernel
def test_a_solve_stops_at_its_share_of_memory(monkeypatch):
    """It refines no further, and says what error that leaves."""
    contract = (Option("put", 100.0, 1.0), Market(100.0, -0.01, 0.2, -0.03))
    monkeypatch.setattr(refinement, "MOST_STORED", 4 * 40 * 200)
    found = solved(MethodOfLines(), contract, tolerance=1e-9)
    assert found.resolution[0].intervals == 256
    assert 1e-7 < found.error[0] < 1e-2


@needs_kernel
@pytest.mark.parametrize("greeks", ["none", "extended"])
def test_the_interrupt_is_asked_inside_a_march(greeks):
    """A portion of the march is a hundred thousand nodes times steps times right-hand sides."""
    contract, asked = (Option("put", 100.0, 200.0), Market(100.0, 0.05, 0.2)), []
    found = solved(
        MethodOfLines(), contract, tolerance=1e-5, greeks=greeks, interrupt=lambda: bool(asked.append(0))
    )
    finest = found.resolution[0]
    assert len(asked) >= 2 * finest.intervals * finest.steps / 100_000
