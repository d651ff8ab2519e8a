"""Max-plus matrices and vectors: float arrays, exact arrays of Fractions, and sparse rows without epsilon."""

from __future__ import annotations

from fractions import Fraction
from math import isinf, isnan
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, issparse

from pricing_core.arrays import BoolVector
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.max_plus.scalars import LARGEST, LARGEST_WHOLE

Numbers: TypeAlias = NDArray[Any]  # float64; or objects: Fractions, -inf and inf
MaxPlusMatrix: TypeAlias = Numbers | csr_array
Scalar: TypeAlias = float | Fraction
Left = TypeVar("Left", bound=MaxPlusMatrix)
Right = TypeVar("Right", bound=MaxPlusMatrix)
Stored = TypeVar("Stored", bound=MaxPlusMatrix)

EPSILON = -np.inf  # the zero of the algebra: no path
TOP = np.inf  # beyond all numbers: a circuit that may be run through for ever
STORAGES = ("csr", "csc", "coo")  # in which a stored zero stays one
WHOLE_LARGEST = int(LARGEST)
WHAT = ("a number", "a vector", "a matrix")
NO_TOP = "numbers and -inf: +inf has no meaning here"


def exact(values: object) -> Numbers:
    """Return the array as Fractions, in which every operation of this package is exact.

    Parameters
    ----------
    values : array_like of int, float, Fraction, -inf and inf
        A float stands for the binary number that it is: write Fraction("0.1") where a tenth is meant.

    Raises
    ------
    InvalidInputError
        An entry is NaN, no real number, or beyond 1e150 in size.

    Notes
    -----
    An exact array has dtype object. With a float array beside it, the result of an operation is float.
    Floats hold whole numbers, also as results, up to 2**53. Cost: some hundred times that of floats.

    Examples
    --------
    >>> exact([[3, EPSILON], [0.5, Fraction(1, 3)]])
    array([[Fraction(3, 1), -inf],
           [Fraction(1, 2), Fraction(1, 3)]], dtype=object)
    """
    try:
        raw = np.array(np.asarray(values), dtype=object)
    except ValueError:
        raise InvalidInputError("values", values, "numbers in rows of one length") from None
    return _exact("values", raw, floats=True)


def is_exact(values: MaxPlusMatrix) -> bool:
    """Return whether the entries are Fractions."""
    return values.dtype == np.object_


def zero_like(values: MaxPlusMatrix) -> Scalar:
    """Return 0.0, or Fraction(0) beside exact entries."""
    return Fraction(0) if is_exact(values) else 0.0


def epsilon(shape: tuple[int, int], like: Numbers) -> Numbers:
    """Return a matrix without an entry, exact or float as `like`."""
    return np.full(shape, EPSILON, dtype=like.dtype)


def sparse(A: object) -> csr_array:
    """Return a float matrix in sparse rows: what is not stored is epsilon, and a stored zero is a zero.

    SciPy's own conversion of a dense matrix would drop the zeros and keep the -inf. Of its formats CSR, CSC and
    COO are taken, and of several entries at one place the largest counts; the others lose or make zeros.

    Parameters
    ----------
    A : array_like or sparse, shape (m, n)

    Examples
    --------
    >>> sparse([[0.0, EPSILON], [EPSILON, 2.0]]).nnz
    2
    """
    matrix = as_matrix("A", A)
    if isinstance(matrix, csr_array):
        return matrix
    row, column = np.nonzero(matrix != EPSILON)
    return rows_of(matrix.shape, row, column, as_floats(matrix[row, column]))


def dense(A: object) -> Numbers:
    """Return a matrix as an array, with -inf for what a sparse one does not store.

    Parameters
    ----------
    A : array_like or sparse, shape (m, n)

    Examples
    --------
    >>> dense(sparse([[0.0, EPSILON], [EPSILON, 2.0]]))
    array([[  0., -inf],
           [-inf,   2.]])
    """
    matrix = as_matrix("A", A)
    if not isinstance(matrix, csr_array):
        return matrix
    full = np.full(matrix.shape, EPSILON)
    full[np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr)), matrix.indices] = matrix.data
    return full


def as_matrix(field: str, A: object, *, top: bool = True) -> MaxPlusMatrix:
    """Return a matrix of float64, of Fractions, or a `csr_array` of its own without -inf.

    Parameters
    ----------
    field : str
        Name of the argument in the error.
    top : bool
        Whether +inf has a meaning here.

    Raises
    ------
    InvalidInputError
        Not a matrix, empty, NaN, +inf where it has no meaning, or no real numbers; numbers beyond 1e150 in size,
        whole numbers beyond 2**53 as floats, a sparse format other than CSR, CSC and COO.
    """
    if issparse(A):
        return _as_sparse(field, A, top)
    return _as_array(field, A, 2, top)


def as_square(field: str, A: object, *, top: bool = True) -> MaxPlusMatrix:
    """Return a square matrix as `as_matrix` does.

    Raises
    ------
    InvalidInputError
        As in `as_matrix`, or the matrix is not square.
    """
    matrix = as_matrix(field, A, top=top)
    if matrix.shape[0] != matrix.shape[1]:
        raise InvalidInputError(field, Told(f"shape {matrix.shape}"), "a square matrix")
    return matrix


def as_vector(field: str, x: object, size: int | None = None, *, top: bool = True) -> Numbers:
    """Return a vector of float64 or of Fractions, of that length where one is told; raises like `as_matrix`."""
    vector = _as_array(field, x, 1, top)
    if size is not None and vector.shape != (size,):
        raise InvalidInputError(field, Told(f"shape {vector.shape}"), f"a vector of length {size}")
    return vector


def alike(left: Left, right: Right) -> tuple[Left, Right]:
    """Return both arguments unchanged where both are exact, and otherwise both as floats."""
    if is_exact(left) and is_exact(right):
        return left, right
    return as_floats(left), as_floats(right)


def all_alike(first: Left, *others: Numbers | None) -> tuple[Left, tuple[Numbers | None, ...]]:
    """Return all arguments that are given, unchanged where all are exact, and otherwise as floats."""
    if is_exact(first) and all(is_exact(other) for other in others if other is not None):
        return first, others
    return as_floats(first), tuple(None if other is None else as_floats(other) for other in others)


def in_range(values: Stored) -> Stored:
    """Return a result unchanged, or raise where it has left the range of floating-point numbers.

    Raises
    ------
    NumericalError
        A number in it is beyond 1e150 in size, and on the way to an infinity, which means something else.
    """
    if _beyond(values.data if isinstance(values, csr_array) else values).any():
        raise NumericalError(
            f"a result is beyond {LARGEST:g} in size: scale the weights, or take fewer steps"
        )
    return values


def is_vector(value: object) -> bool:
    """Return whether the argument has one axis; False for rows of different lengths, which `as_matrix` refuses."""
    try:
        return np.ndim(cast(Any, value)) == 1
    except ValueError:
        return False


def rows_of(shape: tuple[int, int], row: Numbers, column: Numbers, value: Numbers) -> csr_array:
    """Return sparse rows of entries in any order, of which the largest counts at each place."""
    order = np.lexsort((column, row))
    row, column, value = row[order], column[order], value[order]
    if row.size:
        first = np.flatnonzero(np.append(True, (np.diff(row) != 0) | (np.diff(column) != 0)))
        row, column, value = row[first], column[first], np.maximum.reduceat(value, first)
    start = np.searchsorted(row, np.arange(shape[0] + 1))
    return csr_array((value, column, start), shape=shape)


def as_floats(values: Stored) -> Stored:
    """Return Fractions as floats, and floats as they are."""
    return cast(Stored, values.astype(np.float64)) if is_exact(values) else values


def _beyond(values: Numbers) -> BoolVector:
    """Return which entries are beyond 1e150 in size, but no infinities, in one row."""
    if is_exact(values):
        return np.array(
            [isinstance(one, Fraction) and _is_beyond(one) for one in values.flat], dtype=np.bool_
        )
    sizes = np.abs(values.ravel())
    return np.asarray((sizes > LARGEST) & (sizes < TOP))


def _is_beyond(number: Fraction) -> bool:
    return abs(number.numerator) > WHOLE_LARGEST * number.denominator


def _as_array(field: str, value: object, ndim: int, top: bool) -> Numbers:
    try:
        raw: Numbers = np.asarray(value)
    except ValueError:
        raise InvalidInputError(field, value, f"{WHAT[ndim]} with rows of one length") from None
    if np.ma.is_masked(value):
        raise InvalidInputError(
            field, Told("masked entries"), f"{WHAT[ndim]} without a mask; -inf is epsilon"
        )
    if raw.ndim != ndim:
        raise InvalidInputError(field, Told(f"shape {raw.shape}") if raw.ndim else value, WHAT[ndim])
    if not raw.size:
        raise InvalidInputError(field, Told(f"shape {raw.shape}"), f"{WHAT[ndim]} with at least one entry")
    if raw.dtype == np.object_:
        array = _exact(field, raw, floats=False)
    elif raw.dtype.kind not in "fiu":
        raise InvalidInputError(field, value, "real numbers")
    else:
        array = _as_float_array(field, raw)
    if not top and bool((array == TOP).any()):
        raise InvalidInputError(field, Told("+inf in it"), NO_TOP)
    return array


def _as_float_array(field: str, raw: Numbers) -> Numbers:
    if raw.dtype.kind != "f" and ((raw > LARGEST_WHOLE) | (raw < -LARGEST_WHOLE)).any():
        worst = raw.max() if raw.max() > LARGEST_WHOLE else raw.min()
        raise InvalidInputError(field, Told(f"{worst}"), "whole numbers up to 2**53 in size, or exact(...)")
    if raw.dtype.itemsize <= 8:
        raw = raw.astype(np.float64)
    beyond = _beyond(raw)
    if beyond.any():
        worst = np.abs(raw.ravel()[beyond]).max()
        raise InvalidInputError(field, Told(f"{worst!s} in it"), f"numbers up to {LARGEST:g} in size")
    if np.isnan(raw).any():
        raise InvalidInputError(field, Told("NaN in it"), "numbers and -inf")
    return np.array(raw, dtype=np.float64)


def _exact(field: str, raw: Numbers, *, floats: bool) -> Numbers:
    array = np.empty(raw.size, dtype=object)
    array[:] = [_as_fraction(field, entry, floats) for entry in raw.flat]
    return array.reshape(raw.shape)


def _as_fraction(field: str, entry: object, floats: bool) -> Scalar:
    found: Scalar | None = None
    if type(entry) is Fraction:
        found = entry
    elif isinstance(entry, Fraction | int | np.integer) and not isinstance(entry, bool):
        found = Fraction(int(entry)) if isinstance(entry, np.integer) else Fraction(entry)
    elif isinstance(entry, float | np.floating) and not isnan(entry) and (floats or isinf(entry)):
        found = float(entry) if isinf(entry) else Fraction(float(entry))
    if isinstance(found, Fraction) and _is_beyond(found):
        raise InvalidInputError(field, Told("a larger one"), f"numbers up to {LARGEST:g} in size")
    if found is not None:
        return found
    raise InvalidInputError(field, entry, "int, Fraction, -inf or inf in an exact array")


def _as_sparse(field: str, A: Any, top: bool) -> csr_array:
    if A.dtype.kind not in "fiu" or A.ndim != 2 or 0 in A.shape:
        raise InvalidInputError(
            field, Told(f"a {A.dtype} matrix of shape {A.shape}"), "a matrix of real numbers, not empty"
        )
    if A.format not in STORAGES:
        raise InvalidInputError(
            field,
            Told(f"a matrix in {A.format.upper()} format"),
            "in CSR, CSC or COO format: others lose zeros",
        )
    entries = A.tocoo()
    row, column = entries.coords
    value = _as_float_array(field, entries.data)
    if not top and (value == TOP).any():
        raise InvalidInputError(field, Told("+inf in it"), NO_TOP)
    kept = value != EPSILON
    return rows_of(A.shape, row[kept], column[kept], value[kept])
