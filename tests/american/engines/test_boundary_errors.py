"""The errors that prices state of their exercise boundary, against boundaries that are found far more accurately."""

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
    price,
    price_many,
)
from pricing_core.american.book.book import Book
from pricing_core.american.engines.closed_form import ClosedForm
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from pricing_core.american.engines.perpetual import perpetual_boundary
from pricing_core.american.engines.premium_march.flat_contracts import puts_of
from pricing_core.american.engines.premium_march.puts import solve_boundaries
from pricing_core.american.engines.solve import solve
from tests.problems.needs_kernel import needs_kernel

FLAT, DIVIDENDS, CURVE, ESCROWED, BELOW_ZERO = "flat", "dividends", "curve", "escrowed", "rates below 0"


def contracts(family, count):
    """Return random contracts of a family, spots about as far from the strike as they diffuse."""
    random = np.random.default_rng([count, len(family)])
    found = []
    for number in range(count):
        expiry, volatility = np.exp(random.uniform(np.log([0.05, 0.1]), np.log([4.0, 0.7]))).tolist()
        is_put, rate, dividend_yield = number % 2 == 0, *random.uniform([0.01, 0.0], [0.1, 0.08]).tolist()
        more = {}
        if family == DIVIDENDS:
            is_put, times = False, np.sort(random.uniform(0.02, 0.98, 4)) * expiry
            more["cash_dividends"] = [CashDividend(t, random.uniform(0.1, 3.0)) for t in times.tolist()]
        elif family == ESCROWED:
            more["cash_dividends"] = [CashDividend(share * expiry, 2.0) for share in (0.4, 0.8)]
            more["dividend_model"] = "escrowed"
        elif family == CURVE:
            rate = PiecewiseConstant([expiry / 3.0, expiry], random.uniform(0.005, 0.1, 2).tolist())
        elif family == BELOW_ZERO:
            is_put, rate = True, random.uniform(-0.05, -0.005)
            dividend_yield = random.uniform(-0.09, rate - 0.002)
        spot = 100.0 * np.exp(random.uniform(-1.0, 1.0) * volatility * np.sqrt(expiry))
        market = Market(spot, rate, volatility, dividend_yield, **more)
        found.append((Option("put" if is_put else "call", 100.0, expiry), market))
    return found


def errors_over_estimates(book, tolerance, true, of_true):
    """Return how far boundaries are off, over what they state, where there are some, and the errors themselves."""
    found = solve(book, Request(np.full(book.count, tolerance), greeks="none"))
    assert (np.isnan(found.boundary) == np.isnan(found.boundary_error)).all()
    off = np.abs(found.boundary - true)
    ratios = np.maximum(off - of_true, 0.0) / found.boundary_error
    known = np.isfinite(off)
    assert known.sum() > book.count / 3
    return ratios[known], np.median(found.boundary_error[known]) / np.median(off[known])


@needs_kernel
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
def test_errors_of_boundaries_of_flat_contracts_hold(tolerance):
    book = Book.of(contracts(FLAT, 600))
    places, errors, settled = solve_boundaries(puts_of(book), 1e-9)
    assert settled.all()
    true = 100.0 * np.exp(book.sign * places)
    ratios, caution = errors_over_estimates(book, tolerance, true, errors * true)
    assert np.mean(ratios <= 1.0) >= 0.99
    assert caution < 30.0


@needs_kernel
@pytest.mark.parametrize("family", [DIVIDENDS, CURVE, ESCROWED, BELOW_ZERO])
def test_errors_of_boundaries_of_contracts_with_events_hold(family):
    chosen = contracts(family, 40)
    book = Book.of(chosen)
    known = [exercise_boundary(*one, times=[0.0], tolerance=1e-8) for one in chosen]
    true, errors = (
        np.array([getattr(one, name)[0] for one in known]) for name in ("boundary", "error_estimate")
    )
    for tolerance in (1e-4, 1e-6):
        ratios, caution = errors_over_estimates(book, tolerance, true, errors)
        assert np.mean(ratios <= 1.0) >= 0.95
        assert ratios.max() < 8.0
        assert caution < 50.0


def test_the_march_in_numpy_states_the_error_of_its_boundary():
    option, market = (
        Option("call", 100.0, 1.0),
        Market(100.0, 0.05, 0.3, 0.04, cash_dividends=[CashDividend(0.6, 2.0)]),
    )
    fine = exercise_boundary(option, market, times=[0.0], tolerance=1e-7)
    found = ObstacleMarch().solve(Book.of([(option, market)]), Request(np.array([1e-4])))
    off = abs(found.boundary - fine.boundary)
    assert 0.0 < off < found.boundary_error + fine.error_estimate < 0.1 * fine.boundary


@needs_kernel
@pytest.mark.parametrize("volatility", [1e-6, 1e-5])
def test_the_boundary_without_volatility_is_off_by_what_it_states(volatility):
    contract = Option("put", 100.0, 1.0), Market(100.0, 0.05, volatility, 0.01)
    book = Book.of([contract])
    found = ClosedForm().solve(book, Request(np.array([1e-3])))
    # The boundary lies between the strike and that of the option without expiry.
    share = perpetual_boundary(is_put=True, rate=0.05, dividend_yield=0.01, volatility=volatility)
    assert found.boundary.item(0) == 100.0
    assert 0.0 < 100.0 * (1.0 - share) <= found.boundary_error.item(0) == pytest.approx(400.0 * volatility)


def test_what_is_sure_has_no_error_and_what_is_never_exercised_has_none():
    market = Market(100.0, 0.05, 0.2)
    expired, never = price(Option("put", 100.0, 0.0), market), price(Option("call", 100.0, 1.0), market)
    assert (expired.exercise_boundary, expired.boundary_error) == (100.0, 0.0)
    assert (never.exercise_boundary, never.boundary_error) == (None, None)


def test_the_boundary_and_its_error_do_not_depend_on_the_greeks():
    columns = {"option_type": ["put", "call"], "spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    columns |= {"volatility": 0.2, "dividend_yield": [0.0, 0.04], "cash_dividends": [[], [(0.5, 1.0)]]}
    tables = [
        price_many(columns, greeks=greeks, greek_errors=True) for greeks in ("none", "standard", "extended")
    ]
    for name in ("exercise_boundary", "boundary_error"):
        assert np.isfinite(tables[0][name]).all()
        for other in tables[1:]:
            np.testing.assert_array_equal(other[name], tables[0][name])
    assert "boundary_error" not in price_many(columns)
