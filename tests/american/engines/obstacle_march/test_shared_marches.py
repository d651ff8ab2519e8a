"""Contracts with events that differ in the spot alone, from one march."""

from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    price_many,
    value_surface,
)
from pricing_core.american.book.book import Book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch
from pricing_core.american.engines.obstacle_march.shared_marches import REACH, shared_marches
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

DIVIDENDS = [CashDividend(time, 1.5) for time in (0.2, 0.45, 0.95)]
PLAIN = Market(100.0, 0.05, 0.25, 0.02, cash_dividends=DIVIDENDS)
SKEWED = LocalVolatility([0.5], [60.0, 100.0, 160.0], [[0.35, 0.25, 0.2]])
MARKETS = {
    "dividends": PLAIN,
    "escrowed": replace(PLAIN, dividend_model="escrowed"),
    "curve": Market(100.0, PiecewiseConstant([0.4, 1.0], [0.01, 0.07]), 0.3, 0.03),
    "local": replace(PLAIN, volatility=SKEWED),
}
SPOTS = np.linspace(55.0, 160.0, 43)


def ladder(option, market, spots=SPOTS):
    """Return the book of a contract seen from spots."""
    book = Book.at_strike(option, market)
    return replace(book.take(np.zeros(spots.size, dtype=np.int64)), spot=spots)


def surface_request(tolerance, count, *, share):
    return Request(np.full(count, tolerance), share_solves=share, by_rates=False)


@pytest.mark.parametrize("kind", ["put", "call"])
@pytest.mark.parametrize("market", MARKETS.values(), ids=MARKETS)
def test_a_shared_march_gives_what_marches_of_their_own_give(kind, market):
    book = ladder(Option(kind, 100.0, 1.0), market)
    shared = CompiledMarch().solve(book, surface_request(1e-6, book.count, share=True))
    alone = CompiledMarch().solve(
        book, replace(surface_request(1e-7, book.count, share=False), by_rates=True)
    )
    assert (shared.error <= 1e-4).all()
    assert shared.complete.all()
    for name, error in (
        ("value", "error"),
        *((n, f"{n}_error") for n in ("delta", "gamma", "theta", "vega")),
    ):
        off = np.abs(getattr(shared, name) - getattr(alone, name))
        beyond = off > 2.0 * getattr(shared, error) + getattr(
            alone, error
        )  # those of one march miss together
        assert beyond.mean() <= 0.05, name
        assert np.max(off) <= 1e-3 * np.max(np.abs(getattr(alone, name))), name
    np.testing.assert_array_equal(shared.exercised, alone.exercised)
    european = np.abs(shared.european - alone.european)
    assert np.nanmax(european) <= 2e-4


def test_rows_that_differ_in_anything_else_have_marches_of_their_own():
    option, other = Option("put", 100.0, 1.0), Option("put", 100.0, 0.9)
    later = replace(PLAIN, cash_dividends=[replace(DIVIDENDS[0], amount=1.6), *DIVIDENDS[1:]])
    call = replace(option, option_type="call")
    contracts = [(option, PLAIN), (other, PLAIN), (call, PLAIN), (option, later)]
    books = [ladder(*contract, SPOTS[5:]) for contract in contracts]
    rows, owner = shared_marches(Book.concatenated(books))
    assert rows.size == len(books)
    assert [np.unique(part).size for part in np.split(owner, len(books))] == [1] * len(books)
    assert np.unique(owner).size == len(books)


def test_spots_far_apart_have_marches_of_their_own():
    book = ladder(Option("put", 100.0, 0.01), PLAIN, np.linspace(50.0, 200.0, 101))
    rows, owner = shared_marches(book)
    assert rows.size > 10
    for number in range(rows.size):
        own = np.log(book.spot[owner == number])
        assert np.ptp(own) <= REACH * book.deviation[0]


def test_prices_of_a_book_do_not_depend_on_its_order():
    random = np.random.default_rng(3)
    spots, order = random.uniform(60.0, 150.0, 60), random.permutation(60)
    columns = {
        "option_type": "put",
        "spot": spots,
        "strike": 100.0,
        "expiry": 1.0,
        "rate": 0.05,
        "volatility": 0.25,
    }
    columns["cash_dividends"] = [[(0.3, 2.0)]] * 60
    one = price_many(columns, greeks="none", share_solves=True)
    other = price_many(columns | {"spot": spots[order]}, greeks="none", share_solves=True)
    alone = price_many(columns, greeks="none")
    np.testing.assert_array_equal(one["price"][order], other["price"])
    assert (one["status"] == "ok").all()
    off = np.abs(one["price"] - alone["price"])
    assert (off <= one["error_estimate"] + alone["error_estimate"]).all()
    assert off.max() > 0.0  # they are other marches


def test_a_surface_with_dividends_is_that_of_single_prices():
    option = Option("put", 100.0, 1.0)
    surface = value_surface(option, PLAIN, spots=SPOTS, times=[0.0, 0.2, 0.7])
    assert surface.status == "ok"
    seen = {
        0.0: (option, PLAIN),
        0.2: (replace(option, expiry=0.8), replace(PLAIN, cash_dividends=[(0.25, 1.5), (0.75, 1.5)])),
        0.7: (replace(option, expiry=0.3), replace(PLAIN, cash_dividends=[(0.25, 1.5)])),
    }
    for row, contract in enumerate(seen.values()):
        alone = CompiledMarch().solve(ladder(*contract), Request(np.full(SPOTS.size, 1e-7)))
        off = np.abs(surface.value[row] - alone.value)
        assert (off <= surface.error_estimate[row] + alone.error).mean() >= 0.98
        for name in ("delta", "gamma", "theta", "vega"):
            expected = getattr(alone, name)
            assert np.max(np.abs(getattr(surface, name)[row] - expected)) <= 2e-3 * np.max(
                np.abs(expected)
            ), name


def test_a_surface_of_one_spot_needs_no_other_engine():
    option, spots = Option("call", 100.0, 1.0), [100.0]
    found = CompiledMarch().solve(
        ladder(option, PLAIN, np.array(spots)), surface_request(1e-6, 1, share=True)
    )
    assert found.complete.all()
    assert value_surface(option, PLAIN, spots=spots, times=[0.0]).vega[0, 0] == found.vega[0]
