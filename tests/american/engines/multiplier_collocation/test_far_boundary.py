"""Boundaries of puts far below the spot: they are those of contracts seen from there, wherever the spot is."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, exercise_boundary, price, price_many
from pricing_core.american.book.book import Book
from pricing_core.american.engines.multiplier_collocation.far_boundary import DURATION, EXERCISABLE, begun_at
from pricing_core.american.engines.multiplier_collocation.levels import pack
from pricing_core.roots import find_root
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
STRIKE = 100.0


def put_before_dividends(random):
    """Return a put, and its market as a function of the spot: cash, proportional or both, spot model or escrow."""
    expiry = random.uniform(0.1, 2.0)
    times = np.sort(random.uniform(0.02, 0.98, random.integers(1, 5))) * expiry
    cash = random.random(times.size) < 0.7
    sizes = random.uniform(0.002, 0.03, times.size)
    dividends = {
        "cash_dividends": [
            {"time": t, "amount": STRIKE * s}
            for t, s, is_cash in zip(times, sizes, cash, strict=True)
            if is_cash
        ],
        "proportional_dividends": [
            {"time": t, "fraction": s}
            for t, s, is_cash in zip(times, sizes, cash, strict=True)
            if not is_cash
        ],
    }
    rate, dividend_yield, volatility = random.uniform((0.01, 0.0, 0.1), (0.08, 0.04, 0.5))

    def market(spot):
        return Market(spot, rate, volatility, dividend_yield, **dividends)

    return Option("put", STRIKE, expiry), market


def test_they_are_where_exercise_begins_wherever_the_spot_is():
    random, far = np.random.default_rng(41), 0
    for _ in range(60):
        option, market = put_before_dividends(random)
        boundary = price(option, market(110.0), greeks="none").exercise_boundary
        assert boundary is not None
        assert price(option, market(95.0), greeks="none").exercise_boundary == pytest.approx(
            boundary, rel=5e-3
        )
        far += boundary < 20.0
        for share, exercised in ((0.99, True), (1.01, False)):
            seen = price(option, market(share * boundary), tolerance=1e-8, greeks="none")
            assert seen.exercise_now == exercised, (option, market(share * boundary))
    assert far > 15


def test_they_are_found_where_the_spot_spreads_far_before_the_dividend():
    random, whole_lives = np.random.default_rng(3), 0
    for _ in range(60):
        expiry, count = random.uniform(0.5, 3.0), random.integers(1, 4)
        times = np.sort(random.uniform(0.3, 0.98, count)) * expiry
        dividends = [{"time": t, "amount": random.uniform(0.5, 6.0)} for t in times.tolist()]
        rate, dividend_yield, volatility = random.uniform((0.01, 0.0, 0.3), (0.08, 0.05, 0.8))
        option, market = (
            Option("put", STRIKE, expiry),
            Market(140.0, rate, volatility, dividend_yield, dividends),
        )
        boundary = price(option, market, greeks="none").exercise_boundary
        assert boundary is not None
        whole_lives += 5.0 < boundary < 60.0
        for share, exercised in ((0.96, True), (1.04, False)):
            moved = replace(market, spot=share * boundary)
            assert price(option, moved, tolerance=1e-8, greeks="none").exercise_now == exercised, moved
    assert whole_lives > 20


def test_a_tree_of_the_small_spot_agrees():
    """Held until the dividend, which takes min(S, D), and exercised then: Cox, Ross and Rubinstein's tree."""
    steps, random = 1000, np.random.default_rng(42)
    for _ in range(8):
        time, amount, rate, volatility = random.uniform((0.1, 1.0, 0.01, 0.15), (0.6, 3.0, 0.04, 0.4))
        amount = max(amount, 1.1 * STRIKE * np.expm1(rate * time))
        h = time / steps
        up, discount = np.exp(volatility * np.sqrt(h)), np.exp(-rate * h)
        rises = (1.0 / discount - 1.0 / up) / (up - 1.0 / up)

        def gain(spot, amount=amount, up=up, discount=discount, rises=rises):
            """Return what waiting brings more than exercise at a spot."""
            spots = spot * up ** np.arange(-steps, steps + 1)
            value = STRIKE - np.maximum(spots[::2] - amount, 0.0)
            for step in range(steps - 1, -1, -1):
                value = discount * (rises * value[1:] + (1.0 - rises) * value[:-1])
                if step:
                    value = np.maximum(value, STRIKE - spots[steps - step : steps + step + 1 : 2])
            return float(value[0]) - (STRIKE - spot)

        wanted = find_root(gain, 0.01 * amount, 2.0 * amount, 1e-6)
        market = Market(100.0, rate, volatility, cash_dividends=[{"time": time, "amount": amount}])
        found = price(Option("put", STRIKE, 1.0), market, greeks="none").exercise_boundary
        assert found == pytest.approx(wanted, rel=1e-2)


def test_boundaries_over_time_have_honest_errors_and_none_just_before_a_dividend():
    random = np.random.default_rng(43)
    for _ in range(8):
        option, market = put_before_dividends(random)
        at = market(100.0)
        ex_dates = [d.time for d in (*at.cash_dividends, *at.proportional_dividends)]
        times = np.sort([*np.linspace(0.0, 0.9 * min(ex_dates), 3), *ex_dates])
        found = exercise_boundary(option, at, times)
        close = exercise_boundary(option, at, times, tolerance=1e-8)
        far = found.boundary < 0.5 * STRIKE
        apart = np.abs(found.boundary - close.boundary)[far]
        assert np.all(apart <= (found.error_estimate + close.error_estimate)[far] + 1e-9)
        assert not np.isnan(found.boundary[0])


def test_never_exercised_puts_have_none():
    """Without interest, or with more in escrow than interest is worth, waiting costs nothing at any spot."""
    dividend = [{"time": 0.5, "amount": 3.0}]
    option = Option("put", STRIKE, 0.6)
    assert price(option, Market(100.0, 0.0, 0.3, 0.0, dividend)).exercise_boundary is None
    escrowed = Market(100.0, 0.02, 0.3, 0.0, dividend, dividend_model="escrowed")
    assert price(option, escrowed).exercise_boundary is None


def test_a_book_has_the_boundaries_of_its_contracts():
    random = np.random.default_rng(44)
    contracts = [put_before_dividends(random) for _ in range(30)]
    alone = [price(option, market(105.0), greeks="none").exercise_boundary for option, market in contracts]
    columns = {
        "option_type": ["put"] * 30,
        "strike": [STRIKE] * 30,
        "spot": [105.0] * 30,
        "expiry": [option.expiry for option, _ in contracts],
        **{
            name: [getattr(m(105.0), name) for _, m in contracts]
            for name in ("rate", "dividend_yield", "volatility")
        },
        **{
            name: [getattr(m(105.0), name) for _, m in contracts]
            for name in ("cash_dividends", "proportional_dividends")
        },
    }
    np.testing.assert_allclose(price_many(columns, greeks="none")["exercise_boundary"], alone, rtol=1e-12)


@pytest.mark.parametrize("expiry", [1e-12, 1e-6, 1.0])
def test_contracts_begun_later_are_those_of_any_unit_of_time(expiry):
    """The first time is before the dividend, the second that of it, the third after it."""
    market = Market(50.0, 0.05, 0.2, cash_dividends=[{"time": 0.5 * expiry, "amount": 1.0}])
    packed = pack(Book.of([(Option("put", STRIKE, expiry), market)]))
    begun = begun_at(packed, np.array([0.2, 0.5, 0.7]) * expiry)
    assert begun.first.tolist() == [0, 2, 3, 4]
    assert begun.segments[:, DURATION] == pytest.approx(np.array([0.3, 0.5, 0.5, 0.3]) * expiry, rel=1e-9)
    assert begun.segments[:, EXERCISABLE].tolist() == [1.0, 1.0, 0.0, 1.0]
