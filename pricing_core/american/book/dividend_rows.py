"""The rows of a table whose only events are plain cash dividends, read all at once.

Such a row has flat rates, a spot that is no futures price, the spot model and a list of {"time": ..., "amount": ...},
or its JSON text, with nothing but numbers: times that increase strictly inside the option's life, amounts that make a
difference. Any other row, and every fault, is for `contract_from`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book, Listed, Rows
from pricing_core.american.book.column import Column
from pricing_core.american.book.ragged import Ragged, starts
from pricing_core.american.book.reduction import Reduction
from pricing_core.american.book.segments import NEGLIGIBLE, SAME_TIME, Segments
from pricing_core.american.contracts.fields import AMOUNT
from pricing_core.arrays import BoolVector, Vector


def read_dividend_rows(
    column: Column, rows: Rows, arrays: Mapping[str, NDArray[Any]]
) -> tuple[Rows, Book] | None:
    """Return which of the rows could be read, and their contracts; None where none could.

    Parameters
    ----------
    column : Column
        The table's cash dividends.
    rows : int array
        Rows of the table that may have this event alone, and whose numbers are sound.
    arrays : mapping of str to array
        The columns of numbers by name, and is_put and is_american.
    """
    counts, time, amount = column.plain_dividends(rows)
    plain = counts > 0
    if not plain.any():
        return None
    rows = rows[plain]
    part = {name: numbers[rows] for name, numbers in arrays.items()}
    book, sound = _book(part, counts[plain], time, amount)
    kept = np.flatnonzero(sound)
    return rows[kept], book.take(kept)


def _book(
    part: Mapping[str, NDArray[Any]], dividends: NDArray[np.int64], time: Vector, amount: Vector
) -> tuple[Book, BoolVector]:
    """Return contracts with so many dividends each, and which of them `Book.of` would make as well."""
    counts = dividends + 1
    first = starts(counts)
    last = first[1:] - 1
    pays = np.ones(first[-1], dtype=bool)
    pays[last] = False
    start, end, due = np.zeros((3, pays.size))
    end[pays], end[last], due[pays] = time, part["expiry"], amount
    start[pays.nonzero()[0] + 1] = time
    names = ("rate", "dividend_yield", "volatility", "expiry", "strike")
    rate, dividend_yield, volatility, expiry, strike = (np.repeat(part[name], counts) for name in names)
    american = np.repeat(part["is_american"], counts)
    nothing = np.zeros(pays.size)
    segments = Segments(start, end, rate, dividend_yield, volatility, american, american, nothing, due)
    none = Ragged.empty(counts.size)
    listed = Listed(Ragged(starts(dividends), time), none, none, none)
    escrowed = np.zeros(counts.size, dtype=bool)
    reduction = Reduction.of_columns(part)
    book = Book(part["is_put"], part["strike"], part["spot"], escrowed, first, segments, listed, reduction)
    apart = end - start > SAME_TIME * expiry
    counted = ~pays | ((due > NEGLIGIBLE * strike) & (due <= AMOUNT.most))
    return book, np.logical_and.reduceat(apart & counted, first[:-1])
