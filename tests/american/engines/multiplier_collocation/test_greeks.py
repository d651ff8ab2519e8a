"""Greeks of the collocation: against differences of its values, their own finer selves, and between themselves."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.problems import random_contracts as kinds
from benchmarks.problems.random_contracts import rows_of
from pricing_core.american import Market, Option, contract_from
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.differences import Bump
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.multiplier_collocation import MultiplierCollocation
from pricing_core.american.engines.multiplier_collocation.greeks import lacks_cuts
from pricing_core.american.engines.multiplier_collocation.levels import solve_to_tolerance
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts

pytestmark = needs_kernel
ENGINE = MultiplierCollocation()
FINE = 1e-9  # Tolerance, in strikes, of values whose differences are taken; chosen.
# Largest distance to an extrapolated difference, in strikes per 1.00 of a parameter or per 1 of an amount.
CLAIM = 1e-5
GREEKS = ("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "volga", "charm")


def solved(book, tolerance=1e-6, greeks="extended"):
    return ENGINE.solve(book, Request(np.full(book.count, tolerance), greeks))


def difference(value, step):
    """Return the extrapolated central difference, and how far it is from that of the larger step."""
    far, near = ((value(by) - value(-by)) / (2.0 * by) for by in (step, 0.5 * step))
    return near + (near - far) / 3.0, np.abs(near - far)


def bumped_value(book, name):
    """Return the value, in strikes, as a function of a parallel shift of one parameter."""

    def value(by):
        column = getattr(book.segments, name) + by
        changed = replace(book, segments=replace(book.segments, **{name: column}))
        return solve_to_tolerance(changed, np.full(book.count, FINE), 2).value

    return value


def dividend_payers(random, count):
    """Yield contracts with two cash dividends, half of them in escrow."""
    for k in range(count):
        expiry = random.uniform(0.3, 2.0)
        paid = [{"time": share * expiry, "amount": random.uniform(0.2, 2.0)} for share in (0.35, 0.8)]
        rate, dividend_yield = random.uniform(0.01, 0.06, 2)
        model = ("spot", "escrowed")[k % 2]
        option = Option(("put", "call")[k // 2 % 2], 100.0, expiry)
        volatility = random.uniform(0.15, 0.45)
        yield option, Market(100.0, rate, volatility, dividend_yield, paid, dividend_model=model)


@pytest.mark.parametrize(
    ("name", "greek", "step"),
    [("volatility", "vega", 2e-3), ("rate", "rho", 5e-4), ("dividend_yield", "dividend_rho", 5e-4)],
)
def test_they_are_derivatives_of_the_value(name, greek, step):
    book = Book.of(random_contracts(11, 300))
    lowest = np.minimum.reduceat(getattr(book.segments, name), book.first[:-1])
    book = book.take(np.flatnonzero(lowest > 2.0 * step))  # below zero exercise is another matter
    prices = solved(book, greeks="standard")
    wanted, doubt = difference(bumped_value(book, name), step)
    sure = prices.settled & prices.complete & ~prices.exercised & (doubt < CLAIM)
    assert sure.mean() > 0.75
    missed = np.abs(getattr(prices, greek) / book.strike - wanted)[sure]
    assert np.mean(missed <= CLAIM) > 0.96
    assert np.mean(missed <= 20.0 * CLAIM) == 1.0


def test_dividend_sensitivities_are_derivatives_by_every_amount():
    rng = np.random.default_rng(5)
    for contract in [c for c in random_contracts(12, 60) if c[1].cash_dividends][:30]:
        option, market = contract
        found = solved(Book.of([contract]), greeks="standard")
        if not found.complete[0] or found.exercised[0]:
            continue
        k = int(rng.integers(len(market.cash_dividends)))

        def value(by, market=market, option=option, k=k):
            dividends = list(market.cash_dividends)
            dividends[k] = replace(dividends[k], amount=dividends[k].amount + by)
            book = Book.of([(option, replace(market, cash_dividends=tuple(dividends)))])
            return option.strike * solve_to_tolerance(book, np.array([FINE]), 1).value

        wanted, doubt = difference(value, 0.1 * min(0.5, market.cash_dividends[k].amount))
        assert found.dividend_sensitivities.values[k] == pytest.approx(wanted[0], abs=CLAIM + doubt[0])


def test_charm_is_the_derivative_of_delta_by_the_time_that_passes():
    step = 5e-4  # years
    for option, market in random_contracts(13, 100):
        dividends = (*market.cash_dividends, *market.proportional_dividends)
        is_flat = option.exercise == "american" and isinstance(market.rate, float)
        if not (is_flat and dividends) or min(dividend.time for dividend in dividends) < 0.02:
            continue

        def delta(by, option=option, market=market):
            moved = {
                name: tuple(replace(d, time=d.time - by) for d in getattr(market, name))
                for name in ("cash_dividends", "proportional_dividends")
            }
            later = (replace(option, expiry=option.expiry - by), replace(market, **moved))
            return solved(Book.of([later]), 1e-8, "standard").delta

        found = solved(Book.of([(option, market)]))
        if found.exercised[0] or not found.complete[0]:
            continue
        wanted, doubt = difference(delta, step)
        assert found.charm[0] == pytest.approx(wanted[0], abs=1e-4 + 5.0 * doubt[0])


@pytest.mark.parametrize("seed", [31, 32])
def test_charm_is_accurate_next_to_the_boundary(seed):
    """At distances of 0.2 to 5 % from the boundary now, against differences of delta."""
    step, distances, stated = 2e-4, [], []  # years
    random = np.random.default_rng(seed)
    for k, (option, market) in enumerate(dividend_payers(random, 40)):
        at_boundary = solved(Book.of([(option, market)]), 1e-9, "none").boundary[0]
        side = 1.0 if option.is_put else -1.0
        spot = at_boundary * np.exp(side * random.uniform(0.002, 0.05))
        if not 50.0 < spot < 200.0:
            continue

        def delta(by, option=option, market=market, spot=spot):
            dividends = tuple(replace(d, time=d.time - by) for d in market.cash_dividends)
            moved = replace(market, spot=spot, cash_dividends=dividends)
            return solved(Book.of([(replace(option, expiry=option.expiry - by), moved)]), 1e-10, "none").delta

        found = solved(Book.of([(option, replace(market, spot=spot))]))
        wanted, doubt = difference(delta, step)
        if found.exercised[0] or not found.complete[0] or doubt[0] > 1e-4:
            continue
        distances.append(abs(found.charm[0] - wanted[0]) - doubt[0])
        stated.append(found.charm_error[0])
        assert distances[-1] <= 1e-5 + 4.0 * stated[-1], k
    assert len(distances) > 12
    assert np.mean(np.array(distances) <= 1e-5 + np.array(stated)) > 0.9
    assert np.median(distances) < 5e-5
    assert max(distances) < 5e-3


def test_the_errors_are_honest():
    book = Book.of(random_contracts(14, 500))
    prices, exact = solved(book), solved(book, 1e-8)
    sure = prices.complete & exact.complete & ~prices.exercised & (exact.error <= 1e-7 * book.strike)
    assert sure.mean() > 0.75
    for greek in GREEKS:
        error, stated = (
            np.abs(getattr(prices, greek) - getattr(exact, greek)),
            getattr(prices, error_of(greek)),
        )
        own = getattr(exact, error_of(greek))
        assert np.mean((error <= stated + own)[sure]) >= 0.95, greek
    for name in ("dividend_sensitivities", "rate_buckets", "volatility_buckets"):
        column, other = getattr(prices, name), getattr(exact, name)
        chosen = sure[column.owner()]
        error, stated = np.abs(column.values - other.values), getattr(prices, error_of(name)).values
        own = getattr(exact, error_of(name)).values
        assert np.mean((error <= stated + own)[chosen]) >= 0.95, name


def test_the_buckets_sum_to_the_parallel_greek():
    book = Book.of([c for c in random_contracts(15, 150) if not isinstance(c[1].rate, float)])
    prices = solved(book)
    for greek, name in (("vega", "volatility"), ("rho", "rate"), ("dividend_rho", "dividend_yield")):
        buckets: Ragged = getattr(prices, f"{name}_buckets")
        total = np.bincount(buckets.owner(), buckets.values, book.count)
        held = prices.complete & ~prices.exercised
        assert held.sum() > 10
        np.testing.assert_allclose(total[held], getattr(prices, greek)[held], rtol=1e-12, atol=1e-10)


def test_entries_at_which_no_segment_ends_are_told():
    flat = {"times": [0.25, 0.5, 1.0], "values": [0.03, 0.03, 0.05]}
    option = Option("put", 100.0, 1.0)
    book = Book.of(
        [
            (option, Market(100.0, 0.03, 0.2, cash_dividends=[{"time": 0.5, "amount": 0.0}])),
            (option, Market(100.0, 0.03, 0.2, cash_dividends=[{"time": 0.5, "amount": 1.0}])),
            (option, Market(100.0, flat, 0.2)),
        ]
    )
    assert lacks_cuts(book, extended=False).tolist() == [True, False, False]
    assert lacks_cuts(book, extended=True).tolist()[:2] == [True, False]
    found = solved(book)
    assert found.complete.all()
    assert found.dividend_sensitivities.row(0)[0] > 0.1
    assert found.rate_buckets.row(2)[0] < 0.0
    assert found.rate_buckets.row(2)[1] < 0.0


def test_next_to_an_ex_date_and_to_expiry_they_keep_their_accuracy():
    hours = np.array([0.5, 2.0, 8.0, 24.0]) / 8760.0
    for time in hours:
        markets = (
            (
                Option("put", 100.0, 0.25),
                Market(100.0, 0.04, 0.25, cash_dividends=[{"time": time, "amount": 1.0}]),
            ),
            (
                Option("call", 100.0, 0.25),
                Market(104.0, 0.04, 0.25, cash_dividends=[{"time": time, "amount": 1.0}]),
            ),
            (
                Option("put", 100.0, 2.0 * time),
                Market(100.0, 0.04, 0.25, cash_dividends=[{"time": time, "amount": 0.2}]),
            ),
        )
        book = Book.of(list(markets))
        prices = solved(book, greeks="standard")
        assert prices.complete.all()
        wanted, doubt = difference(bumped_value(book, "volatility"), 2e-3)
        np.testing.assert_array_less(np.abs(prices.vega / book.strike - wanted), CLAIM + doubt)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "seed"), [(kinds.curves, 8), (kinds.curves, 9), (kinds.near_yield_with_cash, 9)]
)
def test_volga_is_the_derivative_of_vega(kind, seed):
    """Some values of nearly the same contract are solved otherwise than the others; volga must not be made of these."""
    book = Book.of([contract_from(row) for row in rows_of(kind, 100, seed)])
    found = solved(book)
    step = 0.02 * np.minimum.reduceat(book.segments.volatility, book.first[:-1])
    bumped = Bump(book, "volatility")
    wanted, doubt = difference(lambda by: solved(bumped(by), 1e-8, "standard").vega, step)
    missed, doubt = np.abs(found.volga - wanted) / book.strike, 0.1 * doubt / book.strike
    sure = found.complete & ~found.exercised & (doubt < 1e-3)
    assert sure.mean() > 0.75
    assert np.mean((missed <= 1e-4 + doubt)[sure]) > 0.94
    assert (missed <= 1e-5 + doubt + 5.0 * found.volga_error / book.strike)[sure].all()


@pytest.mark.parametrize("exercise", ["american", "european"])
def test_rho_counts_what_is_left_where_dividends_take_the_whole_spot(exercise):
    """Where the spot is nothing, the strike is paid later, discounted."""
    rng = np.random.default_rng(17)
    contracts = [
        (
            Option("put", 100.0, expiry, exercise=exercise),
            Market(
                rng.uniform(60.0, 120.0),
                rate,
                rng.uniform(0.2, 0.5),
                cash_dividends=[
                    {"time": share * expiry, "amount": rng.uniform(15.0, 30.0)} for share in (0.3, 0.7)
                ],
            ),
        )
        for expiry, rate in zip(rng.uniform(1.0, 5.0, 20), rng.uniform(-0.02, 0.06, 20), strict=True)
    ]
    book = Book.of(contracts)
    prices = solved(book, greeks="standard")
    wanted, doubt = difference(bumped_value(book, "rate"), 5e-4)
    sure = prices.settled & prices.complete & ~prices.exercised & (doubt < 1e-4)
    assert sure.sum() >= 12
    missed = np.abs(prices.rho / book.strike - wanted)[sure]
    assert np.mean(missed <= 1e-3 * np.abs(wanted[sure]) + doubt[sure]) >= 0.9


def test_values_nearby_are_like_the_solution():
    """The middle one is the solution, and the differences are vega and volga."""
    book = Book.of(random_contracts(13, 200))
    step = 0.004 * np.minimum.reduceat(book.segments.volatility, book.first[:-1])
    found = solve_to_tolerance(book, np.full(book.count, 1e-6), 2, walks=1, volatility_step=step)
    known = found.settled & np.isfinite(found.nearby).all(axis=1)
    assert known.mean() > 0.9
    down, same, up = found.nearby[known].T
    np.testing.assert_allclose(same, found.value[known], rtol=0.0, atol=1e-7)
    vega = np.add.reduceat(found.gradient[:, 0, 0, 2], book.first[:-1])[known]
    missed = np.abs((up - down) / (2.0 * step[known]) - vega)
    assert np.mean(missed <= 1e-5 + 1e-3 * np.abs(vega)) > 0.95
