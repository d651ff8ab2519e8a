"""Columns of a table of contracts as arrays of one length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.checks import real_number
from pricing_core.american.contracts.dates import is_meant_as_date
from pricing_core.american.contracts.dividends import is_pair
from pricing_core.american.contracts.fields import EXERCISE_TIMES
from pricing_core.american.contracts.vocabulary import DATES, LISTS, is_missing
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, Told


def broadcast_columns(columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return every column as an array, shape (n,).

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
        A column of lists holds a list, or its text, per row; one list of times or of dividends serves all rows.

    Raises
    ------
    InvalidInputError
        Lengths differ.
    """
    arrays = {name: _as_array(name, values) for name, values in columns.items()}
    lengths = {array.size for array in arrays.values() if array.ndim == 1}
    if any(array.ndim > 1 for array in arrays.values()) or len(lengths) > 1:
        raise _ragged(arrays)
    length = lengths.pop() if lengths else 1
    return {
        name: array if array.ndim else np.broadcast_to(array, (length,)) for name, array in arrays.items()
    }


def _ragged(arrays: Mapping[str, NDArray[Any]]) -> InvalidInputError:
    """Return the fault of columns whose lengths differ, which names those unlike most, the shortest first."""
    counts = Counter(array.size for array in arrays.values() if array.ndim == 1)
    usual = max(counts, key=lambda length: (counts[length], length), default=None)
    others = [
        (array.size, name if array.ndim == 1 else f"{name}, shape {array.shape}, of")
        for name, array in arrays.items()
        if array.ndim > 1 or (array.ndim == 1 and array.size != usual)
    ]
    lengths = ", ".join(map(str, sorted(counts)))
    named = ", ".join(f"{name} {size}" for size, name in sorted(others))
    most = "" if usual is None else f": {usual} as most have"
    return InvalidInputError(
        "columns", Told(f"lengths {lengths}"), f"scalars and vectors of one length{most}, not {named}"
    )


def as_numbers(column: NDArray[Any]) -> Vector:
    """Return a copy as floats, NaN for what is no number."""
    if column.dtype.kind in "fiu":
        return column.astype(np.float64)
    if column.dtype.kind in "mM":  # durations and dates, whose items may be plain integers
        return np.full(column.shape, np.nan)
    return np.array([_number_or_nan(cell) for cell in column.tolist()], dtype=np.float64)


def as_objects(cells: Sequence[object]) -> NDArray[Any]:
    """Return the cells as they are, shape (n,)."""
    array = np.empty(len(cells), dtype=object)
    for row, cell in enumerate(cells):  # one by one: NumPy would make a matrix of lists of one length
        array[row] = cell
    return array


def is_list_of_row(name: str, value: object) -> bool:
    """Tell the list of one row, its text or its absence from an entry of the one list that serves all rows.

    Examples
    --------
    >>> [is_list_of_row("cash_dividends", value) for value in ([(0.25, 1.0)], "[[0.25, 1]]", None, (0.25, 1.0))]
    [True, True, True, False]
    >>> [is_list_of_row("exercise_times", value) for value in ([0.25, 0.5], 0.25, "2026-03-20")]
    [True, False, False]
    """
    if isinstance(value, str):
        return not is_meant_as_date(value)
    if isinstance(value, list | tuple | np.ndarray):
        return name == EXERCISE_TIMES.name or not is_pair(value)
    return is_missing(value)


def plain(cell: object) -> object:
    """Return a number or text of NumPy as one of Python; durations stay, for their item may be a plain integer."""
    return cell.item() if isinstance(cell, np.generic) and cell.dtype.kind in "fiuU" else cell


def _as_array(name: str, values: object) -> NDArray[Any]:
    """Return a column as an array; masked cells become None, which no required field takes."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            return np.asarray(np.ma.filled(values.astype(object), None))
        if name in LISTS:
            return _lists(name, values)
        array = np.asarray(values)
        if array.ndim == 1 and isinstance(values, list | tuple) and _is_mixed(values, array.dtype.kind):
            return as_objects(values)
        if name in (*DATES, "exercise_start") and array.dtype.kind == "M":
            return array.astype("M8[us]").astype(object)  # date-times; None where there is none
        return array
    except ValueError:
        if isinstance(values, list | tuple) and not all(
            isinstance(value, list | tuple | np.ndarray) for value in values
        ):
            return as_objects(values)  # a list among scalars costs its row alone
        raise InvalidInputError(name, type(values).__name__, "a scalar or a vector") from None


def _lists(name: str, values: Any) -> NDArray[Any]:
    """Return a column of lists; shape () where there is one list, or its text, for all rows."""
    if hasattr(values, "__array__"):
        values = list(np.asarray(values)) if np.ndim(values) else np.asarray(values).item()
    if isinstance(values, list | tuple) and any(is_list_of_row(name, value) for value in values):
        return as_objects(values)
    shared = np.empty((), dtype=object)
    shared[()] = values
    return shared


def _is_mixed(cells: Sequence[object], kind: str) -> bool:
    """Whether NumPy has turned truth values into numbers, or numbers into complex ones, durations or texts."""
    if kind in "cmM":
        return any(isinstance(cell, int | float) for cell in cells)
    if kind in "fiu":
        return any(isinstance(cell, bool | np.bool_) for cell in cells)
    return kind in "US" and not all(isinstance(cell, str) for cell in cells)


def _number_or_nan(cell: object) -> float:
    if type(cell) is float:
        return cell
    try:
        return real_number("", cell)
    except InvalidInputError:
        return float("nan")
