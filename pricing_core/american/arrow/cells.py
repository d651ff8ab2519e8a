"""Cells and columns of numbers of Arrow tables as Python and NumPy have them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa

from pricing_core.arrays import Vector


def python_value(cell: pa.Scalar) -> Any:
    """Return a cell as Python has it; a date that Python does not have as the number that stands for it."""
    try:
        return cell.as_py()
    except (OverflowError, ValueError):
        return cell.value


def is_empty(cell: Any) -> bool:
    """Tell whether a cell holds nothing: null, NaN, blank text or an empty list.

    Examples
    --------
    >>> [is_empty(cell) for cell in (None, float("nan"), " ", [], "nan", 0.0)]
    [True, True, True, True, False, False]
    """
    if isinstance(cell, str):
        return not cell.strip(" \t")
    return cell is None or cell == [] or (isinstance(cell, float) and math.isnan(cell))


def number_array(numbers: Vector) -> pa.Array:
    """Return numbers as a column, null for NaN."""
    return pa.array(numbers, pa.float64(), from_pandas=True)


def numbers_of(column: pa.Array) -> Vector:
    """Return a column of numbers, NaN for null; a copy."""
    return np.array(column.to_numpy(zero_copy_only=False), dtype=np.float64)
