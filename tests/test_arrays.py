from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from pricing_core.arrays import (
    as_extended_number,
    as_matrix,
    as_number,
    as_real_array,
    as_share,
    as_values,
    as_vector,
    as_whole_number,
)
from pricing_core.errors import InvalidInputError, NumericalError

HUGE = pytest.param(10**400, id="401 digits")
NO_NUMBERS = [
    "1/2",
    None,
    True,
    1j,
    float("nan"),
    HUGE,
    pytest.param(10**5000, id="5001 digits"),
    Decimal(1),
    [1.0],
    np.array(1.0),
    np.datetime64("2020-01-01"),
]


@pytest.mark.parametrize("read", [as_number, as_extended_number, as_share])
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_number_is_refused_by_name(read, value):
    with pytest.raises(InvalidInputError, match=r"h = .*must be"):
        read("h", value)


@pytest.mark.parametrize(
    "half", [0.5, Fraction(1, 2), np.float64(0.5), np.float32(0.5), np.float16(0.5), np.longdouble(0.5)]
)
def test_every_kind_of_number_is_one(half):
    for read in (as_number, as_extended_number, as_share):
        assert type(read("h", half)) is float
        assert read("h", half) == 0.5
    assert as_vector("v", [half, Fraction(1, 4), np.int64(1), 2]).tolist() == [0.5, 0.25, 1.0, 2.0]


def test_infinite_numbers_are_taken_where_they_mean_something():
    assert as_extended_number("slope", -np.inf) == -np.inf
    with pytest.raises(InvalidInputError, match="finite"):
        as_number("slope", -np.inf)


@pytest.mark.parametrize(
    "value",
    [1.0, np.float64(1.0), "1", True, 0, -1, 4, np.int64(4), HUGE, None],
)
def test_counts_are_whole_numbers_within_their_limits(value):
    with pytest.raises(InvalidInputError, match="steps = "):
        as_whole_number("steps", value, 1, 3)
    assert [as_whole_number("steps", three, 1, 3) for three in (3, np.int8(3), np.uint64(3))] == [3, 3, 3]


@pytest.mark.parametrize("read", [as_vector, as_matrix, as_real_array])
@pytest.mark.parametrize(
    "value",
    [
        "x",
        None,
        [[1], [1, 2]],
        [1j],
        pytest.param([10**400], id="401 digits"),
        pytest.param([10**5000], id="5001 digits"),
        {},
        [np.inf],
    ],
)
def test_what_is_no_array_of_numbers_is_refused_by_name(read, value):
    with pytest.raises(InvalidInputError, match=r"A = .*must be"):
        read("A", value)


def test_what_functions_return_is_checked_as_theirs():
    assert as_values("f", [1, Fraction(1, 2)], (2,)).tolist() == [1.0, 0.5]
    for value in (1.0, [1.0], ["x", "y"], [[1], [1, 2]], [1j, 0]):
        with pytest.raises(InvalidInputError, match="f = "):
            as_values("f", value, (2,))
    with pytest.raises(NumericalError, match="f has no finite value"):
        as_values("f", [1.0, np.nan], (2,))
