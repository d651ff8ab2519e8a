"""The compiled march of books, beside the other engines and known values, family by family."""

import numpy as np
import pytest

from benchmarks.obstacle_march import FAMILIES, random_book
from pricing_core import kernel
from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march.march_book import march_book
from pricing_core.american.engines.solve import solve

pytestmark = pytest.mark.skipif(kernel.march_segments is None, reason="the compiled kernel is absent")


def marched(contracts, tolerance=1e-5):
    book = Book.of(contracts)
    return march_book(book, np.full(book.count, tolerance))


@pytest.mark.parametrize("family", FAMILIES)
def test_prices_lie_within_the_estimates_of_both_engines(family):
    book = random_book(family, 32, seed=11)
    own = march_book(book, np.full(32, 1e-5))
    other = solve(book, Request(np.full(32, 1e-7), greeks="none"))
    assert own.settled.all()
    assert own.met.all()
    missed = np.abs(own.value - other.value) > own.error_estimate + other.error
    assert missed.mean() <= 0.05
    assert np.abs(own.value - other.value).max() < 2e-5


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_a_row_does_not_depend_on_the_others(tolerance):
    book = Book.concatenated([random_book(family, 5, seed=3) for family in FAMILIES])
    together = march_book(book, np.full(book.count, tolerance))
    for row in range(0, book.count, 3):
        alone = march_book(book.take(np.array([row])), np.array([tolerance]))
        assert alone.value[0] == pytest.approx(together.value[row], abs=1e-11)
        assert alone.cells[0] == together.cells[row]


def test_an_escrowed_call_with_a_large_dividend_after_a_small_one():
    """.8991 by a tree; the option without the first dividend's exercise is worth .06."""
    dividends = [(0.02, 1.0), (0.06, 20.0)]
    market = Market(100.0, 0.03, 0.15, cash_dividends=dividends, dividend_model="escrowed")
    found = marched([(Option("call", 100.0, 0.08), market)], 1e-7)
    assert found.value[0] == pytest.approx(0.8991, abs=1e-4)


def test_a_put_beyond_a_boundary_that_two_engines_put_elsewhere():
    """73.42028 by differences on 2,048 nodes: not exercised."""
    market = Market(26.58404959, 0.0237627188, 0.0813081456, 0.0866609149)
    found = marched([(Option("put", 100.0, 3.6466938629), market)], 1e-7)
    assert found.value[0] == pytest.approx(73.42028, abs=1e-5)
    assert not found.exercised[0]


def test_a_dividend_larger_than_the_spot_is_waited_for():
    """The spot drops to 0: to wait is worth the discounted strike at the least."""
    rate, time = 0.053223223, 0.1981747164
    market = Market(1.0603778471, rate, 0.1109076699, 0.0386771411, cash_dividends=[(time, 42.3857777787)])
    found = marched([(Option("put", 100.0, 0.3625585944), market)], 1e-7)
    assert found.value[0] >= 100.0 * np.exp(-rate * time) - found.error_estimate[0]
    assert not found.exercised[0]


def test_delta_and_gamma_are_the_derivatives_of_the_price():
    option = Option("put", 100.0, 1.0)
    dividends = [(0.3, 2.0), (0.8, 2.0)]
    spots = [90.0, 100.0, 115.0]

    def prices(shift):
        markets = [Market(spot + shift, 0.05, 0.25, 0.01, cash_dividends=dividends) for spot in spots]
        return marched([(option, market) for market in markets], 1e-7)

    low, found, high = prices(-0.5), prices(0.0), prices(0.5)
    assert np.allclose(found.delta, (high.value - low.value) / 1.0, atol=2e-5)
    assert np.allclose(found.gamma, (high.value - 2.0 * found.value + low.value) / 0.25, atol=2e-4)


def test_an_interrupt_ends_the_march():
    book = random_book("put, 4 dividends", 4, seed=1)
    found = march_book(book, np.full(4, 1e-6), 1, lambda: True)
    assert np.isnan(found.value).all()


def test_a_table_that_does_not_fit_is_refused():
    one = np.ones(1)
    flags = np.ones(1, dtype=bool)
    columns = dict.fromkeys(
        ("sign", "x", "duration", "rate", "dividend_yield", "volatility", "fraction", "amount", "escrow"), one
    )
    first = np.array([0, 1])
    kernel.SegmentTable(**columns, first=first, exercisable=flags, exercise_at_end=flags)
    for name, value, told in (
        ("volatility", np.zeros(1), "volatility and duration must be above 0"),
        ("x", np.array([np.inf]), "x must be finite"),
        ("rate", np.ones(2), "the columns differ in length"),
        ("first", np.array([0, 2]), "first must have 2 entries"),
    ):
        given = columns | {"first": first} | {name: value}
        with pytest.raises(ValueError, match=told):
            kernel.SegmentTable(**given, exercisable=flags, exercise_at_end=flags)
