import numpy as np
import pytest

from benchmarks.obstacle_march import FAMILIES, TOLERANCES, measure, random_book


@pytest.mark.parametrize(
    ("family", "paid"),
    [("put, 4 dividends", 4), ("call, 4 escrowed dividends", 4), ("put, 12 dividends", 12)],
)
def test_dividends_are_paid_in_order_within_the_life_of_each_option(family: str, paid: int) -> None:
    book = random_book(family, 50)
    dividends = book.listed.cash_dividends
    assert dividends.counts().tolist() == [paid] * 50
    times = dividends.values.reshape(50, paid)
    assert np.all(np.diff(np.column_stack([np.zeros(50), times, book.expiry])) > 0.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_book_is_the_same_each_time(family: str) -> None:
    first, second = random_book(family, 3), random_book(family, 3)
    np.testing.assert_array_equal(first.spot, second.spot)
    assert np.all(first.strike == 1.0)


def test_a_family_has_a_line_for_each_tolerance() -> None:
    lines = measure("call, 4 dividends", 3)
    assert [line.tolerance for line in lines] == list(TOLERANCES)
    for line in lines:
        assert line.root_mean_square <= line.largest_error <= line.tolerance
        assert line.with_greeks_us > 0.0
        assert line.alone_us > 0.0
        assert 0.0 <= line.covered <= 1.0
        assert line.ok == 1.0
