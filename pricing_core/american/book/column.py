"""What a column of a table of contracts must answer, whatever holds it: NumPy arrays or Arrow's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Rows
from pricing_core.arrays import BoolVector, Vector

MISSING, NO_DATE = -1, -2


class Dates(NamedTuple):
    """Dates by number: cell k of the column is `moments[codes[k]]`, or has the code MISSING or NO_DATE."""

    codes: NDArray[np.int64]
    moments: Sequence[object]


class PlainDividends(NamedTuple):
    """Lists of cash dividends that are nothing but numbers, one behind the other.

    Parameters
    ----------
    counts : int array, shape (n,)
        How many each row has; 0 where its cell is anything else than such a list.
    time, amount : Vector, shape (sum of counts,)
        Years and money.
    """

    counts: NDArray[np.int64]
    time: Vector
    amount: Vector


class Column(Protocol):
    """One column of a table, shape (n,); only `cell` makes an object of a row's value."""

    def numbers(self) -> Vector:
        """Return a copy as floats, NaN for what is no number."""
        ...

    def words(self) -> NDArray[np.int8]:
        """Return the places of what the cells mean among the choices of the column's field; -1 for none of them."""
        ...

    def is_empty(self, default: object) -> BoolVector:
        """Tell which cells hold nothing, or nothing else than the default."""
        ...

    def dates(self) -> Dates:
        """Return the cells as dates."""
        ...

    def plain_dividends(self, rows: Rows) -> PlainDividends:
        """Return the cash dividends of some rows."""
        ...

    def cell(self, row: int) -> object:
        """Return one cell as `contract_from` takes it.

        Raises
        ------
        InvalidInputError
            It cannot be read.
        """
        ...
