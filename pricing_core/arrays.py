"""Array aliases and the conversion every public constructor uses."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.errors import InvalidInputError, NumericalError

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]
BoolVector: TypeAlias = NDArray[np.bool_]
IndexSet: TypeAlias = tuple[int, ...]

REACHED = "of a size that floating-point numbers reach"
# A flag column of one contract is looked at a dozen times on the way to its price: `count_nonzero` takes a fifth of the
# time of `any` there, and no more on long columns.


def some(flags: NDArray[Any]) -> bool:
    """Tell whether a flag is set, or a number is not zero."""
    return bool(np.count_nonzero(flags) > 0)


def every(flags: NDArray[Any]) -> bool:
    """Tell whether all flags are set."""
    return bool(np.count_nonzero(flags) == flags.size)


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


def as_array(field: str, value: object) -> NDArray[Any]:
    """Return the value as a NumPy array.

    Raises
    ------
    InvalidInputError
        It is none, such as rows of different lengths.
    """
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(field, value, "an array of numbers, with rows of one length") from error


def as_real_array(field: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return finite floats in any number of dimensions, read-only, or raise InvalidInputError naming `field`."""
    return _finite(field, value, ndim=None)


def as_number(field: str, value: object) -> float:
    """Return a finite real number as a float, or raise InvalidInputError naming `field`.

    Examples
    --------
    >>> as_number("h", np.int64(2)), as_number("h", Fraction(1, 2))
    (2.0, 0.5)
    """
    number = as_extended_number(field, value)
    if not math.isfinite(number):
        raise InvalidInputError(field, value, "a finite number")
    return number


def as_extended_number(field: str, value: object) -> float:
    """Return a real number as a float, or an infinite one, or raise InvalidInputError naming `field`."""
    try:
        number = float(value) if _is_real(value) else math.nan
    except OverflowError as error:
        raise InvalidInputError(field, value, REACHED) from error
    if math.isnan(number):
        raise InvalidInputError(field, value, "a number")
    return number


def as_share(field: str, value: object) -> float:
    """Return a number from 0 to 1, or raise InvalidInputError naming `field`."""
    share = as_number(field, value)
    if not 0.0 <= share <= 1.0:
        raise InvalidInputError(field, value, "a number from 0 to 1")
    return share


def as_whole_number(field: str, value: object, least: int, most: int | None = None) -> int:
    """Return a whole number from the least to the most, or raise InvalidInputError naming `field`."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or int(value) < least or (most is not None and int(value) > most):  # type: ignore[call-overload]
        bounds = f">= {least}" if most is None else f"from {least} to {most}"
        raise InvalidInputError(field, value, f"a whole number {bounds}")
    return int(value)  # type: ignore[call-overload, no-any-return]


def as_values(field: str, value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return what a function that was given has returned, as floats of this shape.

    Raises
    ------
    InvalidInputError
        The function returns something else.
    NumericalError
        Its values are not finite: it was asked where it has none.
    """
    raw = as_array(field, value)
    if raw.shape != shape:
        raise InvalidInputError(field, f"shape {raw.shape}", f"a function with values of shape {shape}")
    if raw.dtype.kind not in "fiu" and not _holds_numbers(raw):
        raise InvalidInputError(field, value, "a function with real values")
    values = np.asarray(raw, dtype=np.float64)
    if not np.isfinite(values).all():
        raise NumericalError(f"{field} has no finite value where the run went: {values.tolist()}")
    return values


def as_pair(field: str, value: object) -> tuple[object, object]:
    """Return the two values that a function has returned, or raise InvalidInputError naming `field`."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise InvalidInputError(field, value, "a function that returns a pair")
    return value[0], value[1]


def check_callable(field: str, value: object, arguments: str) -> None:
    """Raise InvalidInputError unless the value is a function; `arguments` says of what."""
    if not callable(value):
        raise InvalidInputError(field, value, f"a function of {arguments}")


def check_type(field: str, value: object, kind: type) -> None:
    """Raise InvalidInputError unless the value is an object of this class.

    Examples
    --------
    >>> check_type("problem", 3, Fraction)
    Traceback (most recent call last):
        ...
    pricing_core.errors.InvalidInputError: problem = 3: must be an object of class Fraction
    """
    if not isinstance(value, kind):
        raise InvalidInputError(field, value, f"an object of class {kind.__name__}")


def check_list(field: str, value: object) -> None:
    """Raise InvalidInputError unless the value is a list, a tuple or an array of several things."""
    if not isinstance(value, list | tuple) and not (isinstance(value, np.ndarray) and value.ndim > 0):
        raise InvalidInputError(field, value, "a list")


def check_choice(field: str, value: object, allowed: tuple[str, ...]) -> None:
    """Raise InvalidInputError unless the value is one of these words."""
    if not isinstance(value, str) or value not in allowed:
        raise InvalidInputError(field, value, "one of " + ", ".join(f'"{name}"' for name in allowed))


def _finite(field: str, value: ArrayLike, ndim: int | None) -> NDArray[np.float64]:
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InvalidInputError(field, value, "without masked entries")
    raw = as_array(field, value)
    if raw.dtype.kind not in "fiu" and not _holds_numbers(raw):
        raise InvalidInputError(field, value, "real numbers")
    try:
        array = np.array(raw, dtype=np.float64)
    except OverflowError as error:
        raise InvalidInputError(field, value, REACHED) from error
    if ndim is not None and array.ndim != ndim:
        raise InvalidInputError(field, f"shape {array.shape}", ("a number", "a vector", "a matrix")[ndim])
    if not np.isfinite(array).all():
        raise InvalidInputError(field, value, "finite")
    array.flags.writeable = False
    return array


def _holds_numbers(raw: NDArray[Any]) -> bool:
    """Tell whether an array of objects holds nothing but real numbers."""
    return raw.dtype.kind == "O" and all(_is_real(entry) for entry in raw.ravel())


def _is_real(value: object) -> TypeGuard[float]:
    return isinstance(value, Fraction | int | float | np.integer | np.floating) and not isinstance(
        value, bool
    )
