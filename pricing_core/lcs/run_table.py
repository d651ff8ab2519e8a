"""A run as a table of Arrow: the time, and one column for each quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector, check_list
from pricing_core.errors import InvalidInputError, Told
from pricing_core.extras import needs_extra

if TYPE_CHECKING:
    import pyarrow


def table_of(columns: Mapping[str, Vector]) -> pyarrow.Table:
    """Return a table of floats, null where a number is missing.

    Parameters
    ----------
    columns : mapping of Vector, shape (m,) each

    Raises
    ------
    MissingExtraError
        pyarrow, of the extra "batch", is not installed.
    """
    with needs_extra("batch"):
        import pyarrow as pa  # noqa: PLC0415
    return pa.table(
        {name: pa.array(values, pa.float64(), from_pandas=True) for name, values in columns.items()}
    )


def named_columns(
    t: Vector, parts: Sequence[tuple[str, str, NDArray[np.float64], Sequence[str] | None]]
) -> dict[str, Vector]:
    """Return t and the columns of each part by name.

    Parameters
    ----------
    t : Vector, shape (m,)
    parts : sequence of (field, letter, values, names)
        The argument that the names were given as, the letter of x1, x2, ... where they were not, values of shape
        (m, ...), and the names.

    Raises
    ------
    InvalidInputError
        There are not as many names as columns, or one name stands for two of them.
    """
    columns = {"t": t}
    for field, letter, values, names in parts:
        flat = values.reshape(t.size, -1)
        count = flat.shape[1]
        if names is None:
            chosen = [f"{letter}{i + 1}" for i in range(count)]
        else:
            check_list(field, names)
            chosen = [str(name) for name in names]
        if len(chosen) != count:
            raise InvalidInputError(
                field, Told(f"{len(chosen)} names"), f"{count} names, one for each column"
            )
        for name, column in zip(chosen, flat.T, strict=True):
            if name in columns:
                raise InvalidInputError(field, name, "different from the names of the other columns")
            columns[name] = column
    return columns
