"""Columns whose cells are lists of numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector

NOTHING = np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class Ragged:
    """One list of numbers per row, possibly empty.

    Parameters
    ----------
    first : int array, shape (n + 1,)
        Where each row's numbers begin, and the end.
    values : Vector, shape (first[n],)

    Examples
    --------
    >>> column = Ragged.of([(1.0, 2.0), (), (3.0,)])
    >>> column.row(0), column.take(np.array([2, 1])).first.tolist()
    ((1.0, 2.0), [0, 1, 1])
    """

    first: NDArray[np.int64]
    values: Vector

    @classmethod
    def of(cls, rows: Sequence[Sequence[float]]) -> Ragged:
        """Return a column with these lists."""
        counts = np.array([len(row) for row in rows], dtype=np.int64)
        values = np.array([number for row in rows for number in row], dtype=np.float64)
        return cls(starts(counts), values)

    @classmethod
    def empty(cls, count: int) -> Ragged:
        """Return a column of empty lists."""
        return cls(np.zeros(count + 1, dtype=np.int64), NOTHING)

    @classmethod
    def concatenated(cls, parts: Sequence[Ragged]) -> Ragged:
        """Return the rows of several columns in one, in their order."""
        return cls(
            join_starts([part.first for part in parts]), np.concatenate([part.values for part in parts])
        )

    def counts(self) -> NDArray[np.int64]:
        """Return the length of each list, shape (n,)."""
        return np.diff(self.first)

    def owner(self) -> NDArray[np.int64]:
        """Return the row that each value belongs to, shape (first[n],)."""
        return np.repeat(np.arange(self.first.size - 1), self.counts())

    def row(self, row: int) -> tuple[float, ...]:
        """Return the list of one row."""
        return tuple(self.values[self.first[row] : self.first[row + 1]].tolist())

    def known_row(self, row: int) -> tuple[float, ...]:
        """Return the list of one row; the empty one where a number is missing."""
        numbers = self.row(row)
        return () if any(map(math.isnan, numbers)) else numbers

    def known(self) -> Ragged:
        """Return the column with the empty list in the place of those that lack a number."""
        missing = np.isnan(self.values)
        if not missing.any():
            return self
        counts = self.counts()
        counts[self.owner()[missing]] = 0
        return Ragged(starts(counts), self.values[np.repeat(counts > 0, self.counts())])

    def take(self, rows: NDArray[np.intp]) -> Ragged:
        """Return some of the rows, in the order asked for."""
        if self.values.size == 0:
            return Ragged.empty(rows.size)
        first, chosen = gather(self.first, rows)
        return Ragged(first, self.values[chosen])

    def replaced(self, rows: NDArray[np.intp], other: Ragged) -> Ragged:
        """Return the column with the lists of some rows taken, in their order, from another."""
        if self.values.size == 0 and other.values.size == 0:
            return self
        count = self.first.size - 1
        place = np.arange(count)
        place[rows] = count + np.arange(rows.size)
        return Ragged.concatenated([self, other]).take(place)


def starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return where parts of these sizes begin, and the end of the last one, shape (n + 1,)."""
    first = np.zeros(counts.size + 1, dtype=np.int64)
    counts.cumsum(out=first[1:])
    return first


def gather(first: NDArray[np.int64], rows: NDArray[np.intp]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the starts of the parts of some rows when these are put together, and which entries they hold."""
    counts = np.diff(first)[rows]
    together = starts(counts)
    return together, np.repeat(first[rows] - together[:-1], counts) + np.arange(together[-1])


def join_starts(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return the starts of columns put one behind the other, from those of each."""
    return starts(np.concatenate([np.diff(first) for first in parts]))
