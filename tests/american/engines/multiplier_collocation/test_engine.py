"""The collocation as an engine: Greeks, what it gives up, and boundaries."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core import kernel
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
from pricing_core.american.contracts.schedule import make_schedule
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.multiplier_collocation import MultiplierCollocation
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS

pytestmark = needs_kernel
ENGINE = MultiplierCollocation()


def value(contract, **changes):
    option, market = contract
    return solved(ENGINE, (option, replace(market, **changes)), tolerance=1e-8).value[0]


def piece_shifted(curve, piece, by):
    return PiecewiseConstant(curve.times, [v + by * (k == piece) for k, v in enumerate(curve.values)])


def test_without_the_kernel_nothing_is_served(monkeypatch):
    monkeypatch.setattr(kernel, "solve_schedules", None)
    assert not ENGINE.serves(Book.of(list(CONTRACTS.values()))).any()


@pytest.mark.parametrize("name", ["put, curves", "call, curves"])
def test_buckets_are_the_derivatives_by_the_pieces_and_sum_to_the_whole(name):
    contract = _, market = CONTRACTS[name]
    found = solved(ENGINE, contract, tolerance=1e-7, greeks="extended")
    assert found.complete[0]
    for parameter, greek, step in (
        ("rate", "rho", 1e-3),
        ("dividend_yield", "dividend_rho", 1e-3),
        ("volatility", "vega", 1e-3),
    ):
        curve, buckets = getattr(market, parameter), getattr(found, f"{parameter}_buckets").row(0)
        assert len(buckets) == 3
        assert sum(buckets) == pytest.approx(getattr(found, greek)[0], abs=2e-2)
        for piece, bucket in enumerate(buckets):
            if curve.values[piece] < step:  # exercise is another matter below zero
                continue
            up, down = (
                value(contract, **{parameter: piece_shifted(curve, piece, by)}) for by in (step, -step)
            )
            assert bucket == pytest.approx((up - down) / (2.0 * step), abs=2e-2), (parameter, piece)


@pytest.mark.parametrize(
    "name", ["put, quarterly dividends", "put, escrowed", "call, escrowed", "call, quarterly dividends"]
)
def test_dividend_sensitivities_are_the_derivatives_by_the_amounts(name):
    contract = _, market = CONTRACTS[name]
    found = solved(ENGINE, contract, tolerance=1e-7, greeks="standard").dividend_sensitivities.row(0)
    assert len(found) == 4
    for k, sensitivity in enumerate(found):
        moved = [
            [CashDividend(d.time, d.amount + by * (j == k)) for j, d in enumerate(market.cash_dividends)]
            for by in (0.02, -0.02)
        ]
        up, down = (value(contract, cash_dividends=amounts) for amounts in moved)
        assert sensitivity == pytest.approx((up - down) / 0.04, abs=1e-3)


@pytest.mark.nightly
def test_a_price_that_misses_its_tolerance_by_far_is_given_up():
    """Settled is what has its error within the tolerance, or within 1e-6 strikes."""
    book = Book.of(random_contracts(21, 1500))
    book = book.take(np.flatnonzero(ENGINE.serves(book)))
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = ENGINE.solve(book, Request(np.full(book.count, tolerance), "none"))
        assert np.all(
            found.error[found.settled] <= max(tolerance, 1e-6) * book.strike[found.settled] * (1 + 1e-12)
        )
        assert found.settled.mean() > 0.99


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_boundaries_are_within_their_stated_errors(tolerance):
    apart = []
    for option, market in random_contracts(22, 40):
        book = Book.of([(option, market)])
        times = np.array([0.0, 0.3, 0.7, 1.0]) * option.expiry
        found, best = (ENGINE.boundary(book, times, Request(np.array([t]))) for t in (tolerance, 1e-8))
        assert found.found.all()
        known = np.isfinite(found.near) & np.isfinite(best.near)
        apart += (np.abs(found.near - best.near) <= found.error + best.error + 1e-9)[known].tolist()
    assert len(apart) > 50
    assert np.mean(apart) >= 0.98


def test_what_is_exercised_has_no_derivatives_by_parameters():
    option, market = CONTRACTS["call, yield above the rate"]
    found = solved(ENGINE, (option, replace(market, spot=300.0)), greeks="extended")
    assert found.exercised[0]
    assert (found.value[0], found.delta[0], found.vega[0], found.vanna[0]) == (200.0, 1.0, 0.0, 0.0)
    assert found.dividend_sensitivities.row(0) == (0.0,) * 4
    assert found.complete[0]


@pytest.mark.parametrize(
    ("seed", "count"), [(11, 60), pytest.param(12, 600, marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_boundaries_converge_as_told_whatever_the_events(seed, count):
    errors, stated = [], []
    for option, market in random_contracts(seed, count):
        ends = [segment.end for segment in make_schedule(option, market).segments]
        times = np.unique([0.0, *ends, *np.convolve([0.0, *ends], [0.5, 0.5], "valid")])
        rough, close = (exercise_boundary(option, market, times, tolerance=t) for t in (1e-6, 1e-8))
        sure = np.isfinite(rough.boundary) & np.isfinite(rough.error_estimate)
        sure &= np.isfinite(close.boundary) & np.isfinite(close.error_estimate)
        errors += (np.abs(rough.boundary - close.boundary) / close.boundary)[sure].tolist()
        stated += (rough.error_estimate / rough.boundary)[sure].tolist()
    assert len(errors) > 3 * count
    assert np.quantile(errors, 0.99) < 1e-4
    assert max(errors) < 2e-2
    assert np.mean(np.array(errors) <= np.array(stated) + 1e-5) > 0.995


def test_a_boundary_many_deviations_off_is_found_where_it_may_still_be_reached_by_expiry():
    dividends = [CashDividend(time, 0.5) for time in (0.08, 0.33, 0.58, 0.83)]
    market = Market(108.0, rate=0.034, volatility=0.156, dividend_yield=0.026, cash_dividends=dividends)
    option = Option("call", strike=100.0, expiry=2.0)
    boundary = exercise_boundary(option, market, times=[0.0]).boundary[0]
    assert 130.0 < boundary < 150.0
    for spot, exercised in [(boundary * 0.999, False), (boundary * 1.001, True)]:
        value = price(option, Market(spot, 0.034, 0.156, 0.026, dividends), tolerance=1e-8, greeks="none")
        assert value.exercise_now == exercised


def test_greeks_belong_to_the_solution_that_gave_the_price():
    """Vega of 200 random contracts against extrapolated differences of prices at 1e-8; at most 3.9 off without a check.

    At a fixed degree, some boundaries before proportional dividends come out elsewhere than those of the price.
    """
    random = np.random.default_rng(1)
    expiry, dividends = random.uniform(0.08, 2.0, 200), np.empty(200, dtype=object)
    for row, years in enumerate(expiry):
        times = np.sort(random.uniform(0.01, years, random.integers(1, 6)))
        fractions = random.uniform(0.003, 0.02, times.size)
        dividends[row] = [{"time": t, "fraction": f} for t, f in zip(times, fractions, strict=True)]
    columns = {
        "option_type": np.where(random.random(200) < 0.6, "put", "call"),
        "strike": np.full(200, 100.0),
        "spot": 100.0 * np.exp(random.normal(0.0, 0.2, 200)),
        "expiry": expiry,
        "rate": random.uniform(0.005, 0.08, 200),
        "volatility": random.uniform(0.1, 0.6, 200),
        "proportional_dividends": dividends,
    }

    def vega(step):
        up, down = (
            price_many(columns | {"volatility": columns["volatility"] + by}, tolerance=1e-8, greeks="none")
            for by in (step, -step)
        )
        return (up["price"] - down["price"]) / (2.0 * step)

    found, wide, narrow = price_many(columns), vega(2e-3), vega(1e-3)
    known = np.abs(wide - narrow) < 3e-3
    assert np.mean(known) >= 0.98
    error = np.abs(found["vega"] - (4.0 * narrow - wide) / 3.0)[known]
    assert error.max() <= 0.05
    assert np.mean(error > 0.01) <= 0.02


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_dividends_that_come_close_are_worth_what_one_dividend_is(option_type):
    """The paths of the spot differ by the second amount times its growth between the two, within deviations of that."""
    random = np.random.default_rng(41)
    for _ in range(12):
        expiry, volatility = random.uniform(0.2, 3.0), random.uniform(0.1, 0.5)
        option = Option(option_type, 100.0, expiry)
        first, second = random.uniform(0.1, 2.0, 2)
        time, apart = random.uniform(0.1, 0.8) * expiry, expiry * 10.0 ** random.uniform(-6.5, -4.0)
        market = Market(random.uniform(80.0, 120.0), random.uniform(0.01, 0.08), volatility)
        apart_by = replace(
            market, cash_dividends=(CashDividend(time, first), CashDividend(time + apart, second))
        )
        together = replace(market, cash_dividends=(CashDividend(time, first + second),))
        found, one = (solved(ENGINE, (option, each), tolerance=1e-6) for each in (apart_by, together))
        assert found.settled[0]
        moved = second * volatility * np.sqrt(apart) + 10.0 * apart
        assert abs(found.value[0] - one.value[0]) <= found.error[0] + one.error[0] + moved
