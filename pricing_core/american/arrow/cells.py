"""Single cells of Arrow tables as Python has them."""

from __future__ import annotations

import math
from typing import Any

import pyarrow as pa


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
