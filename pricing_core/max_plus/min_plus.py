"""Min-plus algebra: the same operations with the minimum in the place of the maximum, and +inf as zero.

Each one is that of max-plus between two changes of sign: what is not stored in a sparse matrix is +inf here,
and +inf absorbs.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from scipy.sparse import csr_array, issparse

from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.algebra import add as largest_sum
from pricing_core.max_plus.algebra import multiply as largest_product
from pricing_core.max_plus.algebra import power as largest_power
from pricing_core.max_plus.cycle_time import cycle_time as largest_rates
from pricing_core.max_plus.matrices import (
    TOP,
    MaxPlusMatrix,
    Numbers,
    Scalar,
    as_matrix,
    as_vector,
    dense,
    is_vector,
)
from pricing_core.max_plus.spectrum import eigenvalue as largest_mean
from pricing_core.max_plus.star import plus as largest_plus
from pricing_core.max_plus.star import star as largest_star


def add(A: object, B: object) -> MaxPlusMatrix:
    """Return the entrywise minimum; see `pricing_core.max_plus.add`.

    Examples
    --------
    >>> add([[3.0, 1.0]], [[2.0, 4.0]])
    array([[2., 1.]])
    """
    return _negative(largest_sum(_negated("A", A), _negated("B", B)))


def multiply(A: object, B: object) -> MaxPlusMatrix:
    """Return the product, C_ij = min_k A_ik + B_kj; see `pricing_core.max_plus.multiply`.

    Examples
    --------
    >>> multiply([[3.0, 7.0], [2.0, 4.0]], [1.0, 0.0])
    array([4., 3.])
    """
    return _negative(largest_product(_negated("A", A), _negated("B", B)))


def power(A: object, k: int) -> MaxPlusMatrix:
    """Return the k-th power; see `pricing_core.max_plus.power`.

    Examples
    --------
    >>> power([[2.0, 5.0], [3.0, 3.0]], 2)
    array([[4., 7.],
           [5., 6.]])
    """
    return _negative(largest_power(_negated("A", A), k))


def star(A: object, *, tolerance: float | None = None) -> MaxPlusMatrix:
    """Return the least weights of paths from j to i, -inf behind a circuit of negative weight: shortest paths.

    See `pricing_core.max_plus.star`.

    Examples
    --------
    >>> star([[np.inf, 4.0, 1.0], [np.inf, np.inf, np.inf], [np.inf, 2.0, np.inf]])
    array([[ 0.,  3.,  1.],
           [inf,  0., inf],
           [inf,  2.,  0.]])
    """
    return _negative(largest_star(_negated("A", A), tolerance=tolerance))


def plus(A: object, *, tolerance: float | None = None) -> MaxPlusMatrix:
    """Return the least weights of paths of at least one arc; see `pricing_core.max_plus.plus`.

    Examples
    --------
    >>> plus([[2.0]])
    array([[2.]])
    """
    return _negative(largest_plus(_negated("A", A), tolerance=tolerance))


def eigenvalue(A: object) -> Scalar:
    """Return the least mean weight of a circuit, +inf without one; see `pricing_core.max_plus.eigenvalue`.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or -inf.

    Examples
    --------
    >>> eigenvalue([[3.0, 7.0], [2.0, 4.0]])
    3.0
    """
    return -largest_mean(_without_epsilon(A))


def cycle_time(A: object) -> Numbers:
    """Return lim x(k) / k of x(k+1) = A x(k), shape (n,); see `pricing_core.max_plus.cycle_time`.

    Examples
    --------
    >>> cycle_time([[3.0, 7.0], [2.0, 4.0]])
    array([3., 3.])
    """
    return -largest_rates(_without_epsilon(A))


def _negated(field: str, value: object) -> MaxPlusMatrix:
    """Return minus the argument; a sparse one is negated where it stores, so that the rest stays the zero."""
    if issparse(value):
        as_matrix(field, value)
        return as_matrix(field, -cast(Any, value).astype(np.float64))
    return np.asarray(-(as_vector(field, value) if is_vector(value) else dense(as_matrix(field, value))))


def _without_epsilon(A: object) -> MaxPlusMatrix:
    """Return minus a matrix of numbers and +inf."""
    matrix = _negated("A", A)
    stored = matrix.data if isinstance(matrix, csr_array) else matrix
    if (stored == TOP).any():
        raise InvalidInputError("A", Told("-inf in it"), "numbers and +inf: -inf has no meaning here")
    return matrix


def _negative(value: MaxPlusMatrix) -> MaxPlusMatrix:
    if isinstance(value, csr_array):
        return csr_array((0.0 - value.data, value.indices, value.indptr), shape=value.shape)
    return np.asarray(0 - value)  # no -0.0
