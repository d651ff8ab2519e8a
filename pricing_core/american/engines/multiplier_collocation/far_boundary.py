"""Exercise boundaries of puts far below the spot, where the price does not depend on them.

Before a dividend a put is worth exercising only where the interest until then, K (e^{rt} - 1), is more than the spot
will pay: below that small a spot. There the spot is next to certain, which tells about where the boundary is. It is
then solved for as seen from that place, in most contracts up to the dividend that is waited for alone: what it leaves
of so small a spot is exercised at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.ragged import starts
from pricing_core.american.contracts.schedule import SAME_TIME
from pricing_core.american.engines.multiplier_collocation.levels import (
    AMOUNT,
    ESCROW,
    FINEST,
    Packed,
    kernel_values,
)
from pricing_core.arrays import BoolVector, Matrix, Vector

DURATION, RATE, YIELD, VOLATILITY, EXERCISABLE, _, FRACTION = range(7)  # columns of a segment
FIRST_LEVEL = 2  # Coarsest level at which such a boundary is found to a thousandth of itself; measured.
# How many levels coarser than the price a whole life is solved, and the level that it needs where the standard
# deviation of ln S over one of its segments is large; measured: such boundaries are mostly found to half a hundredth.
COARSER_LEVELS = 2
LEVEL_OF_LONG_WAITS, LONG_WAIT = 4, 0.25
# Smallest spot, in strikes, of a boundary that each level of the kernel sees: some times its own smallest spot.
SMALLEST_SPOTS = 5.0 * np.array([1e-3, 4e-4, 5e-5, 1e-5, 2e-6, 4e-7, 1e-7])
# Largest move of ln S, in standard deviations, after which the rest of a spot must still be exercised; chosen.
FURTHEST_MOVE = 4.0
# Largest rest of a spot over the smallest one at which waiting would go on if it were certain; measured.
LARGEST_REST = 0.5
# Where the boundary of a whole life is looked for, in standard deviations of ln S below that spot; chosen.
SEEN_FROM = 1.5
SMALLEST_REST = (
    1e-3  # Share of a spot that a dividend leaves at least, so that its logarithm is finite; chosen.
)


class _Waiting(NamedTuple):
    """The smallest spot, in strikes, at which n puts are held if it is certain, and until the end of which segment.

    The spot is NaN where they are held at any, `last` the place of the segment in the schedule; both have shape (n,).
    """

    spot: Vector
    last: NDArray[np.int64]


def far_boundaries(
    packed: Packed, level: NDArray[np.int64], threads: int, interrupt: Callable[[], bool] | None = None
) -> Vector:
    """Return ln(S*/K) now of puts that may be exercised, shape (n,); NaN of others, and where it is not found.

    Parameters
    ----------
    packed : Packed
        n contracts; where the spot is now does not count.
    level : int array, shape (n,)
        The level of the price.
    """
    found = np.full(packed.x.size, np.nan)
    rows = np.flatnonzero(_may_be_exercised(packed))
    if rows.size:
        waiting = _waiting(packed.take(rows))
        seen = waiting.spot > SMALLEST_SPOTS[FINEST]
        rows, waiting = rows[seen], _Waiting(waiting.spot[seen], waiting.last[seen])
    if rows.size == 0:
        return found
    part, spot = packed.take(rows), waiting.spot
    last, is_over = _end_of_waiting(part, waiting)
    lower = np.where(is_over, 0.0, SEEN_FROM * np.sqrt(_variance(part)))
    seen = _until(replace(part, x=np.log(spot) - lower), last)
    needed = np.argmax(spot[:, None] > SMALLEST_SPOTS, axis=1)
    spread = np.maximum.reduceat(_spreads(part), part.first[:-1])
    of_wait = np.maximum(level[rows], FIRST_LEVEL)
    of_life = np.maximum(level[rows] - COARSER_LEVELS, np.where(spread > LONG_WAIT, LEVEL_OF_LONG_WAITS, 0))
    level = np.maximum(np.where(is_over, of_wait, of_life), needed)
    solved = kernel_values(seen, level, threads, np.zeros(rows.size), interrupt=interrupt)
    found[rows] = np.where(solved.settled, solved.numbers[3], np.nan)
    return found


def begun_at(packed: Packed, times: Vector) -> Packed:
    """Return one contract as it is just after each of these times before expiry; its spots have no meaning.

    Where the spot drops then, the contract may not be exercised: just before, no put is exercised far below.
    """
    ends = np.cumsum(packed.segments[:, DURATION])
    same = SAME_TIME * ends[-1]
    places = np.searchsorted(ends - same, times, side="right")
    counts = ends.size - places
    segments = np.concatenate([packed.segments[place:] for place in places])
    first = starts(counts)
    segments[first[:-1], DURATION] = ends[places] - times
    before = np.maximum(places - 1, 0)
    drops = (packed.segments[before, FRACTION] > 0.0) | (packed.segments[before, AMOUNT] > 0.0)
    at_drop = (np.abs(ends[before] - times) <= same) & drops
    segments[first[:-1], EXERCISABLE] *= ~at_drop
    return Packed(np.repeat(packed.sign, times.size), np.zeros(times.size), first, segments)


def _may_be_exercised(packed: Packed) -> BoolVector:
    """Tell for which contracts waiting costs something now, and they may be exercised, at a spot of zero."""
    now = packed.segments[packed.first[:-1]]
    exercised: BoolVector = (packed.sign > 0.0) & (now[:, EXERCISABLE] > 0.0) & (now[:, RATE] > 0.0)
    return exercised


def _waiting(packed: Packed) -> _Waiting:
    """Return until when the puts are held at the smallest spot, if spots are certain, at which that is worth it.

    Waiting until t costs K (e^{rt} - 1), less what the strike rises by as escrow is paid, and brings what the spot
    pays: a share of it and an amount, but no more than all of it.
    """
    first, segments = packed.first[:-1], packed.segments
    counts = np.diff(packed.first)
    kept = np.log(np.maximum(1.0 - segments[:, FRACTION], SMALLEST_REST))
    duration = segments[:, DURATION]
    per_segment = segments[:, RATE] * duration, kept - segments[:, YIELD] * duration, segments[:, AMOUNT]
    interest, kept, amount = _running(np.stack(per_segment), packed)
    growth = np.exp(interest)
    at_start = segments[:, ESCROW] * np.exp(-segments[:, RATE] * duration)
    escrow_after = np.append(at_start[1:], 0.0)
    escrow_after[packed.first[1:] - 1] = 0.0
    cost = growth * (1.0 - np.repeat(at_start[first], counts)) - (1.0 - escrow_after)
    share = -np.expm1(kept)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_share = np.where(share > 0.0, (cost - amount) / share, np.where(cost > amount, np.inf, 0.0))
    spot = np.minimum(np.maximum(cost, by_share), 1.0)
    smallest = np.minimum.reduceat(spot, first)
    is_smallest = spot <= np.repeat(smallest, counts)
    last = np.minimum.reduceat(np.where(is_smallest, _places(packed), spot.size), first)
    return _Waiting(np.where(smallest > 0.0, smallest, np.nan), last)


def _end_of_waiting(packed: Packed, waiting: _Waiting) -> tuple[NDArray[np.int64], BoolVector]:
    """Return after which segment the puts are exercised at once, and whether there is one before expiry."""
    last, ends = waiting.last.copy(), np.diff(packed.first) - 1
    is_over = np.zeros(last.size, dtype=bool)
    rows, step = np.arange(last.size), 1
    while rows.size:
        is_over[rows] = _leaves_nothing(packed.take(rows), waiting.spot[rows], last[rows])
        rows = rows[~is_over[rows] & (last[rows] < ends[rows])]
        last[rows] = np.minimum(last[rows] + step, ends[rows])
        step *= 2
    return last, is_over


def _leaves_nothing(packed: Packed, spot: Vector, last: NDArray[np.int64]) -> BoolVector:
    """Tell for which puts the spot has paid so much until `last`, before expiry, that they are exercised then."""
    counts = np.diff(packed.first)
    until = _until(packed, last)
    kept = _total(np.log(np.maximum(1.0 - until.segments[:, FRACTION], SMALLEST_REST)), until)
    left = spot * np.exp(FURTHEST_MOVE * np.sqrt(_variance(until)) + kept) - _total(
        until.segments[:, AMOUNT], until
    )
    nothing = np.zeros(spot.size, dtype=bool)
    later = np.flatnonzero(last < counts - 1)
    if later.size:
        rest = packed.take(later)
        rest = _chosen(rest, _places(rest) > np.repeat(last[later], counts[later]))
        begun = rest.segments[rest.first[:-1]]
        may = (begun[:, EXERCISABLE] > 0.0) & (begun[:, ESCROW] == 0.0)
        nothing[later] = may & (left[later] <= LARGEST_REST * np.nan_to_num(_waiting(rest).spot))
    return nothing


def _places(packed: Packed) -> NDArray[np.int64]:
    """Return the place of every segment in its schedule."""
    return np.arange(len(packed.segments)) - np.repeat(packed.first[:-1], np.diff(packed.first))


def _until(packed: Packed, last: NDArray[np.int64]) -> Packed:
    """Return the contracts with the segment at the place `last` as their last one."""
    return _chosen(packed, _places(packed) <= np.repeat(last, np.diff(packed.first)))


def _chosen(packed: Packed, chosen: BoolVector) -> Packed:
    """Return the contracts with these segments alone, of each one at least."""
    first = starts(np.add.reduceat(chosen.astype(np.int64), packed.first[:-1]))
    return replace(packed, first=first, segments=packed.segments[chosen])


def _variance(packed: Packed) -> Vector:
    """Return the variance of ln S at the end, shape (n,)."""
    return _total(_spreads(packed) ** 2, packed)


def _spreads(packed: Packed) -> Vector:
    """Return the standard deviation of ln S over each segment."""
    spreads: Vector = packed.segments[:, VOLATILITY] * np.sqrt(packed.segments[:, DURATION])
    return spreads


def _total(column: Vector, packed: Packed) -> Vector:
    total: Vector = np.add.reduceat(column, packed.first[:-1])
    return total


def _running(columns: Matrix, packed: Packed) -> Matrix:
    """Return the sums over the segments of each schedule up to each of them, of k columns, shape (k, m)."""
    counts = np.diff(packed.first)
    there = np.arange(counts.max()) < counts[:, None]
    filled = np.zeros((len(columns), *there.shape))
    filled[:, there] = columns
    running: Matrix = np.cumsum(filled, axis=2)[:, there]  # each of its own numbers alone, to the last bit
    return running
