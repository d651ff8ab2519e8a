"""Segments cut at further times, which changes nothing of the contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.ragged import Ragged, starts
from pricing_core.american.book.segments import SAME_TIME, Segments
from pricing_core.arrays import Vector


def with_cuts(book: Book, times: Ragged) -> Book:
    """Return the contracts with a segment ending at each of these times before expiry.

    Parameters
    ----------
    times : Ragged
        Years from now, one list per contract.

    Examples
    --------
    >>> from pricing_core.american import Market, Option
    >>> book = Book.of([(Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2))])
    >>> with_cuts(book, Ragged.of([(0.25, 2.0)])).segments.end.tolist()
    [0.25, 1.0]
    """
    segment = [_cut(_ends(book, row), times.row(row)) for row in range(book.count)]
    if all(ends.size == count for (ends, _), count in zip(segment, np.diff(book.first), strict=True)):
        return book
    counts = np.array([ends.size for ends, _ in segment], dtype=np.int64)
    first = starts(counts)
    end = np.concatenate([ends for ends, _ in segment])
    source = np.concatenate([book.first[row] + places for row, (_, places) in enumerate(segment)])
    start = np.append(0.0, end[:-1])
    start[first[:-1]] = 0.0
    old = book.segments.take(source)
    is_new = end != old.end
    segments = Segments(
        start,
        end,
        old.rate,
        old.dividend_yield,
        old.volatility,
        old.exercisable,
        np.where(is_new, old.exercisable, old.exercise_at_end),
        np.where(is_new, 0.0, old.fraction),
        np.where(is_new, 0.0, old.due),
    )
    return replace(book, first=first, segments=segments)


def _ends(book: Book, row: int) -> Vector:
    return book.segments.end[book.first[row] : book.first[row + 1]]


def _cut(ends: Vector, times: tuple[float, ...]) -> tuple[Vector, Rows]:
    """Return the ends with further ones between them, and the old segment that each new one is part of."""
    same = SAME_TIME * ends[-1]
    further = [t for t in times if same < t < ends[-1] - same and np.abs(ends - t).min() > same]
    together = np.unique(np.concatenate([ends, further]))
    return together, np.searchsorted(ends, together)
