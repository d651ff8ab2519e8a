"""Max-plus matrices and vectors: float arrays, exact arrays of Fractions, and sparse rows without epsilon."""

from fractions import Fraction
from math import isinf, isnan
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, issparse

from pricing_core.errors import InvalidInputError, Told

Numbers: TypeAlias = NDArray[Any]  # float64; or objects: Fractions, -inf and inf
MaxPlusMatrix: TypeAlias = Numbers | csr_array
Scalar: TypeAlias = float | Fraction
Left = TypeVar("Left", bound=MaxPlusMatrix)
Right = TypeVar("Right", bound=MaxPlusMatrix)

EPSILON = -np.inf  # the zero of the algebra: no path
TOP = np.inf  # beyond all numbers: a circuit that may be run through for ever
LARGEST_WHOLE = 2**53  # up to here every whole number is a float
WHAT = ("a number", "a vector", "a matrix")


def exact(values: object) -> Numbers:
    """Return the array as Fractions, in which every operation of this package is exact.

    Parameters
    ----------
    values : array_like of int, float, Fraction, -inf and inf
        A float stands for the binary number that it is: write Fraction("0.1") where a tenth is meant.

    Raises
    ------
    InvalidInputError
        An entry is NaN or no real number.

    Notes
    -----
    An exact array has dtype object. With a float array beside it, the result of an operation is float.
    Cost: some hundred times that of floats.

    Examples
    --------
    >>> exact([[3, EPSILON], [0.5, Fraction(1, 3)]])
    array([[Fraction(3, 1), -inf],
           [Fraction(1, 2), Fraction(1, 3)]], dtype=object)
    """
    return _exact("values", np.array(np.asarray(values), dtype=object), floats=True)


def is_exact(values: MaxPlusMatrix) -> bool:
    """Return whether the entries are Fractions."""
    return values.dtype == np.object_


def zero_like(values: MaxPlusMatrix) -> Scalar:
    """Return 0.0, or Fraction(0) beside exact entries."""
    return Fraction(0) if is_exact(values) else 0.0


def sparse(A: object) -> csr_array:
    """Return a float matrix in sparse rows: what is not stored is epsilon, and a stored zero is a zero.

    SciPy's own conversion of a dense matrix would drop the zeros and keep the -inf.

    Examples
    --------
    >>> sparse([[0.0, EPSILON], [EPSILON, 2.0]]).nnz
    2
    """
    matrix = as_matrix("A", A)
    if isinstance(matrix, csr_array):
        return matrix
    row, column = np.nonzero(matrix != EPSILON)
    return rows_of(matrix.shape, row, column, matrix[row, column].astype(np.float64))


def dense(A: object) -> Numbers:
    """Return a matrix as an array, with -inf for what a sparse one does not store.

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
        Not a matrix, empty, NaN, +inf where it has no meaning, or no real numbers.
    """
    if issparse(A):
        return _as_sparse(field, A, top)
    return _as_array(field, A, 2, top)


def as_square(field: str, A: object, *, top: bool = True) -> MaxPlusMatrix:
    """Return a square matrix as `as_matrix` does.

    Raises
    ------
    InvalidInputError
        As there, or the matrix is not square.
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
    """Return both as they are where both are exact, else both as floats."""
    if is_exact(left) and is_exact(right):
        return left, right
    return cast(Left, _floats(left)), cast(Right, _floats(right))


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


def _floats(values: MaxPlusMatrix) -> MaxPlusMatrix:
    return values.astype(np.float64) if is_exact(values) else values


def _as_array(field: str, value: object, ndim: int, top: bool) -> Numbers:
    try:
        raw: Numbers = np.asarray(value)
    except ValueError:
        raise InvalidInputError(field, value, f"{WHAT[ndim]} with rows of one length") from None
    if raw.ndim != ndim:
        raise InvalidInputError(field, Told(f"shape {raw.shape}"), WHAT[ndim])
    if not raw.size:
        raise InvalidInputError(field, Told(f"shape {raw.shape}"), f"{WHAT[ndim]} with at least one entry")
    if raw.dtype == np.object_:
        array = _exact(field, raw, floats=False)
    elif raw.dtype.kind not in "fiu":
        raise InvalidInputError(field, value, "real numbers")
    else:
        if raw.dtype.kind != "f" and ((raw > LARGEST_WHOLE) | (raw < -LARGEST_WHOLE)).any():
            raise InvalidInputError(
                field, Told(f"{raw.max()}"), "whole numbers up to 2**53 in size, or exact(...)"
            )
        array = np.array(raw, dtype=np.float64)
        if np.isnan(array).any():
            raise InvalidInputError(field, Told("NaN in it"), "numbers and -inf")
    if not top and bool((array == TOP).any()):
        raise InvalidInputError(field, Told("+inf in it"), "numbers and -inf: +inf has no meaning here")
    return array


def _exact(field: str, raw: Numbers, *, floats: bool) -> Numbers:
    array = np.empty(raw.size, dtype=object)
    array[:] = [_as_fraction(field, entry, floats) for entry in raw.flat]
    return array.reshape(raw.shape)


def _as_fraction(field: str, entry: object, floats: bool) -> Scalar:
    if isinstance(entry, Fraction | int | np.integer) and not isinstance(entry, bool):
        return Fraction(int(entry)) if isinstance(entry, np.integer) else Fraction(entry)
    if isinstance(entry, float | np.floating) and not isnan(entry) and (floats or isinf(entry)):
        return float(entry) if isinf(entry) else Fraction(float(entry))
    raise InvalidInputError(field, entry, "int, Fraction, -inf or inf in an exact array")


def _as_sparse(field: str, A: Any, top: bool) -> csr_array:
    if A.dtype.kind not in "fiu" or A.ndim != 2 or 0 in A.shape:
        raise InvalidInputError(
            field, Told(f"a {A.dtype} matrix of shape {A.shape}"), "a matrix of real numbers, not empty"
        )
    entries = A.tocoo()
    row, column = entries.coords
    value = entries.data.astype(np.float64)
    if np.isnan(value).any():
        raise InvalidInputError(field, Told("NaN in it"), "numbers and -inf")
    if not top and (value == TOP).any():
        raise InvalidInputError(field, Told("+inf in it"), "numbers and -inf: +inf has no meaning here")
    kept = value != EPSILON
    return rows_of(A.shape, row[kept], column[kept], value[kept])
