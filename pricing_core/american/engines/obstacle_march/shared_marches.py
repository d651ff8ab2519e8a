"""Which contracts of a book one march prices together: those that differ in the spot alone."""

from __future__ import annotations

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.segments import columns_of

# Standard deviations of ln S over which spots share a march: its grid reaches as many further. Chosen.
REACH = 4.0


def shared_marches(book: Book) -> tuple[Rows, Rows]:
    """Return rows of the book that are marched, and for each row which of these marches prices it, shape (n,).

    Spots that lie far from each other have marches of their own.
    """
    segments = np.column_stack(columns_of(book.segments))
    terms = np.column_stack([book.is_put, book.strike, book.escrowed])
    with np.errstate(divide="ignore"):
        x = np.log(book.diffusing())
    order, widths = np.argsort(x, kind="stable"), REACH * book.deviation
    owner = np.empty(book.count, dtype=np.int64)
    chosen: list[int] = []
    known: dict[tuple[bytes, bytes, int], tuple[int, float]] = {}
    for row in order.tolist():
        local = 0 if book.local is None or book.local[row] is None else id(book.local[row].volatility)
        own = segments[book.first[row] : book.first[row + 1]]
        key = own.tobytes(), terms[row].tobytes(), local
        number, lowest = known.get(key, (-1, 0.0))
        if number < 0 or x[row] - lowest > widths[row]:
            number, lowest = known[key] = len(chosen), x[row]
            chosen.append(row)
        owner[row] = number
    return np.array(chosen, dtype=np.int64), owner
