"""Every contract of the promised domain has a price within its bounds, from the kernel, whatever else is asked."""

import numpy as np
import pytest

from pricing_core.american.book.book import Book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from tests.problems.needs_kernel import needs_kernel
from tests.problems.whole_domain import random_contracts

pytestmark = needs_kernel
TOLERANCE = 1e-6


def asked(book, greeks):
    return solve(book, Request(np.full(book.count, TOLERANCE), greeks))


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 250), pytest.param(2, 20_000, marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_prices_lie_within_their_bounds_and_depend_on_nothing_else(seed, count):
    book = Book.of(random_contracts(seed, count))
    prices, with_greeks = asked(book, "none"), asked(book, "standard")
    assert np.mean(with_greeks.complete) > 0.99
    assert set(prices.status) <= {"ok", "tolerance_not_met"}
    assert np.array_equal(prices.status == "ok", prices.error <= TOLERANCE * book.strike)
    assert np.mean(prices.status == "ok") > 0.9
    np.testing.assert_array_equal(prices.value, with_greeks.value)
    size = np.maximum(book.spot, book.strike)
    now = book.now.exercisable
    assert np.all(prices.value >= np.where(now, book.payoff(), 0.0) - 1e-12 * size)
    known = np.isfinite(prices.european)
    short = prices.european - prices.value - prices.error
    assert np.all(short[known] <= 1e-9 * size[known])
    for row in range(0, count, 20):
        alone = asked(book.part(slice(row, row + 1)), "none")
        assert alone.value[0] == prices.value[row]
        assert alone.error[0] == prices.error[row]
