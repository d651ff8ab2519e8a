import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, ProportionalDividend
from pricing_core.american.book.book import Book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, ObstacleMarch
from tests.problems.needs_kernel import needs_kernel
from tests.problems.nightly import nightly

CONTRACTS = 60
ENGINES = [pytest.param(CompiledMarch(), marks=needs_kernel), ObstacleMarch()]
COMPILED = ENGINES[:1]
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


def boundaries(engine, book, times, tolerance):
    return engine.boundary(book, Request(np.array([tolerance])))(times)


def missed(engine, numbers, tolerance):
    """Return the errors of boundaries over what is claimed of them, against a hundredth of the tolerance."""
    ratios = []
    for number in numbers:
        option, market = contract(number)
        book = Book.at_strike(option, market)
        ends = book.segments.end
        times = np.unique(np.concatenate([[0.0], ends, ends[-1] * np.linspace(0.0, 0.999, 24)]))[:-1]
        if option.exercise == "bermudan":  # none in between
            times = np.concatenate([[0.0], ends[:-1]])
        found, true = (boundaries(engine, book, times, own) for own in (tolerance, tolerance / 100.0))
        both = ~(np.isnan(found.near) | np.isnan(true.near))
        assert (np.isnan(found.near) != np.isnan(true.near)).sum() <= 1  # it comes or goes then
        ratios += (np.abs(found.near - true.near) / (found.error + 1e-7))[both].tolist()
    return np.array(ratios)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("first", range(6))
def test_boundaries_lie_within_their_estimates(engine, first):
    ratios = missed(engine, [first], 1e-3)
    assert np.count_nonzero(ratios > 1.0) <= 2
    assert ratios.max(initial=0.0) <= MOST


@pytest.mark.parametrize("engine", [*COMPILED, *nightly(ENGINES[1:])])
def test_boundaries_of_many_contracts_lie_within_their_estimates(engine):
    ratios = missed(engine, range(CONTRACTS), 1e-3)
    assert np.mean(ratios <= 1.0) >= MOSTLY
    assert ratios.max() <= MOST


@needs_kernel
def test_both_engines_find_the_same_boundaries():
    for number in range(6):
        option, market = contract(number)
        book = Book.at_strike(option, market)
        ends = book.segments.end
        times = np.concatenate([[0.0], ends[:-1]])
        found, other = (
            boundaries(engine, book, times, 1e-4) for engine in (CompiledMarch(), ObstacleMarch())
        )
        assert (np.isnan(found.near) == np.isnan(other.near)).all()
        known = ~np.isnan(found.near)
        allowed = 2.0 * (found.error + other.error)[known] + 1e-7
        assert (np.abs(found.near - other.near)[known] <= allowed).all(), number


@pytest.mark.parametrize("engine", ENGINES)
def test_boundary_ends_at_its_limit_before_expiry(engine):
    book = Book.at_strike(
        Option("put", 100.0, 2.0),
        Market(100.0, 0.04, 0.3, proportional_dividends=[ProportionalDividend(0.6, 0.05)]),
    )
    before = 2.0 - np.array([1e-10, 1e-7, 1e-5])
    near = boundaries(engine, book, before, 1e-4).near
    assert (np.diff(near) < 0.0).all()
    # The leading term of the boundary at expiry (Barles, Burdeau, Romano, Samsoen 1995), which is approached slowly.
    tau = 2.0 - before
    leading = 100.0 * (1.0 - 0.3 * np.sqrt(tau * np.log(1.0 / tau)))
    assert near == pytest.approx(leading, abs=0.35)


@pytest.mark.parametrize("engine", ENGINES)
def test_no_second_boundary_appears_where_the_first_falls_fast(engine):
    market = Market(
        95.0,
        PiecewiseConstant([0.5, 1.0, 3.0], [0.02, 0.06, 0.04]),
        PiecewiseConstant([0.7, 3.0], [0.2, 0.3]),
        proportional_dividends=[ProportionalDividend(0.6, 0.05), ProportionalDividend(1.6, 0.05)],
    )
    book = Book.at_strike(Option("put", 100.0, 2.0), market)
    found = boundaries(engine, book, np.linspace(0.0, 1.99, 200), 1e-4)
    assert np.isnan(found.far).all()


def test_one_book_is_solved_once(monkeypatch):
    book = Book.at_strike(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.0, [CashDividend(0.5, 2.0)]))
    boundary = ObstacleMarch().boundary(book, Request(np.array([1e-4])))
    found = boundary(np.array([0.6, 0.9]))

    def solve(*_):
        raise AssertionError

    monkeypatch.setattr("pricing_core.american.engines.obstacle_march.pricing.solve", solve)
    assert boundary(np.array([0.6])).near[0] == found.near[0]
