import math

import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, ProportionalDividend
from pricing_core.american.book.book import Book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import MarchOfOneBook, ObstacleMarch
from pricing_core.american.engines.obstacle_march.pricing import BoundariesOf

CONTRACTS = 30
# A boundary that comes or goes is steep in time; there the estimate may be missed, by no more than so much.
MOSTLY, MOST = 0.98, 8.0


def contract(number):
    """Return a random contract, by turns with dividends, curves, and a window or dates."""
    random = np.random.default_rng(number)
    expiry = random.choice([0.3, 1.0, 2.5]).item()
    rate, volatility = random.uniform([0.0, 0.1], [0.08, 0.5]).tolist()
    dividend_yield = random.uniform(0.0, 0.08) if number % 3 else 0.0
    option, market = {}, {}
    if number % 6 in (0, 3, 5):
        times = np.sort(random.uniform(0.05, 0.95, random.integers(1, 5))) * expiry
        market["cash_dividends"] = tuple(CashDividend(t, random.uniform(0.5, 3.0)) for t in times.tolist())
        market["dividend_model"] = "escrowed" if random.random() < 0.3 else "spot"
    if number % 6 == 1:
        dividend = ProportionalDividend(random.uniform(0.2, 0.8) * expiry, random.uniform(0.01, 0.06))
        market["proportional_dividends"] = [dividend]
    if number % 6 in (2, 5):
        rate = PiecewiseConstant([0.3 * expiry, 0.7 * expiry, expiry], random.uniform(0.01, 0.08, 3).tolist())
        volatility = PiecewiseConstant([0.5 * expiry, expiry], random.uniform(0.1, 0.4, 2).tolist())
    if number % 12 == 4:
        dates = np.sort(random.uniform(0.1, 0.95, 4)) * expiry
        option = {"exercise": "bermudan", "exercise_times": tuple(dates.tolist())}
    elif number % 12 == 10:
        option = {"exercise_start": random.uniform(0.1, 0.6) * expiry}
    kind = "call" if number % 2 else "put"
    return Option(kind, 100.0, expiry, **option), Market(100.0, rate, volatility, dividend_yield, **market)


def boundaries(book, times, tolerance):
    return BoundariesOf(book, Request(np.array([tolerance])))(times)


def missed(numbers, tolerance):
    """Return the errors of boundaries over what is claimed of them, against a hundredth of the tolerance."""
    ratios = []
    for number in numbers:
        option, market = contract(number)
        book = Book.at_strike(option, market)
        ends = book.segments.end
        times = np.unique(np.concatenate([[0.0], ends, ends[-1] * np.linspace(0.0, 0.999, 24)]))[:-1]
        if option.exercise == "bermudan":  # none in between
            times = np.concatenate([[0.0], ends[:-1]])
        found, true = boundaries(book, times, tolerance), boundaries(book, times, tolerance / 100.0)
        both = ~(np.isnan(found.near) | np.isnan(true.near))
        assert (np.isnan(found.near) != np.isnan(true.near)).sum() <= 1  # it comes or goes then
        ratios += (np.abs(found.near - true.near) / (found.error + 1e-7))[both].tolist()
    return np.array(ratios)


@pytest.mark.parametrize("first", range(6))
def test_boundaries_lie_within_their_estimates(first):
    ratios = missed([first], 1e-3)
    assert np.count_nonzero(ratios > 1.0) <= 2
    assert ratios.max(initial=0.0) <= MOST


@pytest.mark.nightly
def test_boundaries_of_many_contracts_lie_within_their_estimates():
    ratios = missed(range(CONTRACTS), 1e-3)
    assert np.mean(ratios <= 1.0) >= MOSTLY
    assert ratios.max() <= MOST


def test_boundary_ends_at_its_limit_before_expiry():
    book = Book.at_strike(
        Option("put", 100.0, 2.0),
        Market(100.0, 0.04, 0.3, proportional_dividends=[ProportionalDividend(0.6, 0.05)]),
    )
    before = 2.0 - np.array([1e-10, 1e-7, 1e-5])
    near = boundaries(book, before, 1e-4).near
    assert (np.diff(near) < 0.0).all()
    # The leading term of the boundary at expiry (Barles, Burdeau, Romano, Samsoen 1995), which is approached slowly.
    tau = 2.0 - before
    leading = 100.0 * (1.0 - 0.3 * np.sqrt(tau * np.log(1.0 / tau)))
    assert near == pytest.approx(leading, abs=0.35)


def test_no_second_boundary_appears_where_the_first_falls_fast():
    market = Market(
        95.0,
        PiecewiseConstant([0.5, 1.0, 3.0], [0.02, 0.06, 0.04]),
        PiecewiseConstant([0.7, 3.0], [0.2, 0.3]),
        proportional_dividends=[ProportionalDividend(0.6, 0.05), ProportionalDividend(1.6, 0.05)],
    )
    book = Book.at_strike(Option("put", 100.0, 2.0), market)
    found = boundaries(book, np.linspace(0.0, 1.99, 200), 1e-4)
    assert np.isnan(found.far).all()


def test_one_book_is_solved_once_and_answers_as_the_engine_does(monkeypatch):
    book = Book.at_strike(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.0, [CashDividend(0.5, 2.0)]))
    request, times = Request(np.array([1e-4])), np.array([0.6, 0.9])
    engine = MarchOfOneBook(1e-4)
    found, plain = engine.boundary(book, times, request), ObstacleMarch().boundary(book, times, request)
    for mine, its in zip(found, plain, strict=True):
        np.testing.assert_array_equal(mine, its)

    def solve(*_):
        raise AssertionError

    monkeypatch.setattr("pricing_core.american.engines.obstacle_march.pricing.solve", solve)
    again = engine.boundary(book, times[:1], request)
    assert math.isclose(again.near[0], plain.near[0])
