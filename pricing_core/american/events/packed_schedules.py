"""Schedules in columns, as the kernel takes them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.schedule import Schedule
from pricing_core.arrays import BoolVector, Matrix, Vector

EXERCISE = slice(4, 6)  # the columns of a stretch that tell when the holder may exercise


class Stretches(NamedTuple):
    """Times without events inside and the events at their ends, as in `Segment`; money in strikes."""

    duration: Vector
    rate: Vector
    dividend_yield: Vector
    volatility: Vector
    exercisable: Vector  # 0 or 1, as the next one
    exercise_at_end: Vector
    fraction: Vector
    amount: Vector
    escrow: Vector


@dataclass(frozen=True, slots=True, eq=False)
class PackedSchedules:
    """n schedules with m stretches in all, those of one schedule in the order of time, at least one of each.

    Parameters
    ----------
    sign : Vector, shape (n,)
        1 for a put, -1 for a call.
    strike, spot : Vector, shape (n,)
        Money; the spot is S* in the escrowed model.
    x : Vector, shape (n,)
        ln(spot/strike).
    first : int array, shape (n + 1,)
        Where the stretches of each begin.
    stretches : Matrix, shape (m, 9)
        The columns of `Stretches`.
    """

    sign: Vector
    strike: Vector
    spot: Vector
    x: Vector
    first: NDArray[np.int64]
    stretches: Matrix

    def take(self, rows: NDArray[np.intp]) -> "PackedSchedules":
        """Return some of them, in their order."""
        if rows.size == self.x.size:
            return self
        first = _starts(np.diff(self.first)[rows])
        chosen = np.repeat(self.first[rows] - first[:-1], np.diff(first)) + np.arange(first[-1])
        sign, strike, spot, x = (column[rows] for column in (self.sign, self.strike, self.spot, self.x))
        return PackedSchedules(sign, strike, spot, x, first, self.stretches[chosen])

    def joined(self, other: "PackedSchedules") -> "PackedSchedules":
        """Return these and then the others."""
        first = np.concatenate([self.first, self.first[-1] + other.first[1:]])
        names = ("sign", "strike", "spot", "x")
        sign, strike, spot, x = (
            np.concatenate([getattr(self, name), getattr(other, name)]) for name in names
        )
        return PackedSchedules(
            sign, strike, spot, x, first, np.concatenate([self.stretches, other.stretches])
        )

    def european(self) -> "PackedSchedules":
        """Return the same options without early exercise."""
        stretches = self.stretches.copy()
        stretches[:, EXERCISE] = 0.0
        return replace(self, stretches=stretches)

    def columns(self) -> Stretches:
        """Return all stretches by column."""
        return Stretches(*self.stretches.T)

    def first_columns(self) -> Stretches:
        """Return the first stretch of each schedule by column."""
        return Stretches(*self.stretches[self.first[:-1]].T)

    def escrow_now(self) -> Vector:
        """Return A now, money."""
        now = self.first_columns()
        return self.strike * now.escrow * np.exp(-now.rate * now.duration)

    def by_place(self) -> Iterator[tuple[NDArray[np.intp], NDArray[np.int64]]]:
        """Yield for the first, second, ... stretch the schedules that have one, and where it is."""
        rows, counts = np.arange(self.x.size), np.diff(self.first)
        for place in range(int(counts.max(initial=0))):
            rows = rows[counts[rows] > place]
            yield rows, self.first[rows] + place


def pack(schedules: Sequence[Schedule]) -> PackedSchedules:
    """Return the schedules in columns."""
    rows = [
        (
            segment.duration,
            segment.rate,
            segment.dividend_yield,
            segment.volatility,
            segment.exercisable,
            segment.exercise_at_end,
            segment.fraction,
            segment.amount,
            segment.escrow,
        )
        for schedule in schedules
        for segment in schedule.segments
    ]
    return pack_columns(
        np.array([schedule.is_put for schedule in schedules], dtype=bool),
        np.array([schedule.strike for schedule in schedules], dtype=np.float64),
        np.array([schedule.spot for schedule in schedules], dtype=np.float64),
        np.array([len(schedule.segments) for schedule in schedules], dtype=np.int64),
        np.array(rows, dtype=np.float64).reshape(len(rows), 9),
    )


def pack_columns(
    is_put: BoolVector, strike: Vector, spot: Vector, counts: NDArray[np.int64], stretches: Matrix
) -> PackedSchedules:
    """Return the schedules with so many stretches each, whose money is not yet in strikes."""
    with np.errstate(divide="ignore"):  # a spot of 0
        x = np.log(spot) - np.log(strike)
    scale = np.ones((counts.size, 9))
    scale[:, 7:] = strike[:, None]
    stretches = stretches / np.repeat(scale, counts, axis=0)
    return PackedSchedules(np.where(is_put, 1.0, -1.0), strike, spot, x, _starts(counts), stretches)


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts, dtype=np.int64)])
