import math

import numpy as np
import pytest

from pricing_core.american.book.prices import CACHED, LISTS, Prices, concatenated, prices
from pricing_core.american.book.ragged import Ragged


def some(count, start=0.0):
    lists = Ragged.of([tuple(np.arange(row % 3) + start) for row in range(count)])
    return prices(
        count,
        value=np.arange(count) + start,
        status=np.array([f"row {row + start:g}" for row in range(count)], dtype=object),
        settled=True,
        solves=np.arange(count),
        dividend_sensitivities=lists,
    )


def assert_same(one, other):
    for name in Prices.__slots__:
        mine, its = getattr(one, name), getattr(other, name)
        if name in LISTS:
            np.testing.assert_array_equal(mine.first, its.first, err_msg=name)
            mine, its = mine.values, its.values
        np.testing.assert_array_equal(mine, its, err_msg=name)


@pytest.mark.parametrize("count", [0, 1, 5, CACHED, CACHED + 3])
def test_columns_that_are_not_given_hold_nothing(count):
    found = prices(count, method="closed-form", value=1.5)
    assert found.count == count
    assert np.all(found.value == 1.5)
    assert np.isnan(found.vega).all()
    assert set(found.method) <= {"closed-form"}
    assert set(found.status) <= {"ok"}
    for name in ("exercised", "settled", "complete", "fitted", "solves", "steps", "residual"):
        assert not getattr(found, name).any()
    assert found.rate_buckets.counts().tolist() == [0] * count
    assert set(found.resolution) <= {None}


def test_an_unknown_column_is_refused():
    with pytest.raises(TypeError, match="colour"):
        prices(2, colour=np.zeros(2))
    with pytest.raises(KeyError, match="colour"):
        prices(2, colour="red")


def test_what_prices_share_cannot_be_written_to():
    found = prices(3, value=1.0)
    with pytest.raises(ValueError, match="read-only"):
        found.value[0] = 2.0
    assert math.isnan(prices(3).value[0])
    assert prices(3, value=1.0).value.tolist() == [1.0] * 3


@pytest.mark.parametrize("rows", [[], [3], [4, 0, 4], [4, 3, 2, 1, 0]])
def test_taking_rows_takes_every_column(rows):
    found = some(5).take(np.array(rows, dtype=np.intp))
    assert found.value.tolist() == rows
    assert found.status.tolist() == [f"row {row}" for row in rows]
    assert [found.dividend_sensitivities.row(k) for k in range(len(rows))] == [
        some(5).dividend_sensitivities.row(row) for row in rows
    ]


@pytest.mark.parametrize("rows", [[], [2], [4, 1], [0, 1, 2, 3, 4], [3, 0, 4, 2, 1]])
def test_replaced_rows_come_from_the_others_in_their_order(rows):
    chosen = np.array(rows, dtype=np.intp)
    before, found = some(5), some(len(rows), start=10.0)
    after = before.replaced(chosen, found)
    assert_same(after.take(chosen), found)
    others = np.setdiff1d(np.arange(5), chosen)
    assert_same(after.take(others), before.take(others))
    assert_same(before, some(5))  # nothing is written to


def test_concatenated_prices_are_one_behind_the_other():
    parts = [some(2), some(0), some(3, start=20.0)]
    together = concatenated(parts)
    assert_same(together.take(np.array([0, 1])), parts[0])
    assert_same(together.take(np.array([2, 3, 4])), parts[2])
    assert concatenated(parts[:1]) is parts[0]
