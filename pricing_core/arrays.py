"""Array aliases and the conversion every public constructor uses."""

from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.errors import InvalidInputError

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]
BoolVector: TypeAlias = NDArray[np.bool_]
IndexSet: TypeAlias = tuple[int, ...]


def as_vector(field: str, value: ArrayLike, size: int | None = None) -> Vector:
    """Return a read-only finite float vector, or raise InvalidInputError naming `field`.

    Parameters
    ----------
    value : array_like, shape (n,)
    size : int, optional
        Required length.
    """
    array = _finite(field, value, ndim=1)
    if size is not None and array.shape != (size,):
        raise InvalidInputError(field, f"shape {array.shape}", f"a vector of length {size}")
    return array


def as_increasing(field: str, value: ArrayLike) -> Vector:
    """Return a read-only, non-empty, finite and increasing vector, or raise InvalidInputError naming `field`."""
    array = as_vector(field, value)
    if array.size == 0 or np.any(np.diff(array) <= 0.0):
        raise InvalidInputError(field, value, "a non-empty increasing vector")
    return array


def as_matrix(field: str, value: ArrayLike, shape: tuple[int, int] | None = None) -> Matrix:
    """Return a read-only finite float matrix, or raise InvalidInputError naming `field`."""
    array = _finite(field, value, ndim=2)
    if shape is not None and array.shape != shape:
        raise InvalidInputError(field, f"shape {array.shape}", f"a matrix of shape {shape}")
    return array


def as_square_matrix(field: str, value: ArrayLike) -> Matrix:
    """Return a read-only finite square float matrix, or raise InvalidInputError naming `field`."""
    array = _finite(field, value, ndim=2)
    if array.shape[0] != array.shape[1]:
        raise InvalidInputError(field, f"shape {array.shape}", "a square matrix")
    return array


def _finite(field: str, value: ArrayLike, ndim: int) -> NDArray[np.float64]:
    raw: Any = np.asarray(value)
    if raw.dtype.kind not in "fiu" and not _holds_fractions(raw):
        raise InvalidInputError(field, value, "real numbers")
    try:
        array = np.array(raw, dtype=np.float64)
    except OverflowError as error:
        raise InvalidInputError(field, value, "of a size that floating-point numbers reach") from error
    if array.ndim != ndim:
        raise InvalidInputError(field, f"shape {array.shape}", ("a number", "a vector", "a matrix")[ndim])
    if not np.isfinite(array).all():
        raise InvalidInputError(field, value, "finite")
    array.flags.writeable = False
    return array


def _holds_fractions(raw: NDArray[Any]) -> bool:
    """Tell whether an array of objects holds nothing but Fraction, int and float."""
    return raw.dtype.kind == "O" and all(
        isinstance(entry, Fraction | int | float) and not isinstance(entry, bool) for entry in raw.ravel()
    )
