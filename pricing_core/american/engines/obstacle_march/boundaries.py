"""Exercise boundaries over time, from the contact sets at the ends of the steps of a solved contract."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pricing_core.american.contracts.fields import SPOT
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.exercise_region import earning_region, region_at_expiry
from pricing_core.american.engines.obstacle_march.contract_problem import GONE, contract_problem
from pricing_core.arrays import Matrix, Vector
from pricing_core.obstacle import ObstacleSolution, solve
from pricing_core.obstacle.march import March, SegmentMarch
from pricing_core.obstacle.profile import Intervals
from pricing_core.obstacle.solution import held_before

POINTS = 4  # of the polynomials in the root of time through a boundary at the ends of steps
# Two resolutions may agree by chance at one time: they are compared at others as well, which are these shares of the
# time to a piece's end later; chosen.
AROUND = np.array([0.0, -0.15, -0.05, 0.05, 0.15, 0.3])
SHARE = 2.0  # Error of a boundary over the difference of two resolutions; calibrated.
GAP = 2.0  # Cells between two contact sets, or one and an end of the interval, that no grid resolves; chosen.
# Tolerance of a solve that is asked where the boundary is, in strikes, where the price's own has not met it; chosen.
ELSEWHERE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """The ends of the exercise region at m times, money: the one nearer the strike with its error, and the other."""

    near: Vector
    far: Vector
    error: Vector

    def completed_by(self, other: Ends) -> Ends:
        """Return these ends, each with that of another solve where there is none."""
        no_near, no_far = np.isnan(self.near), np.isnan(self.far)
        return Ends(
            np.where(no_near, other.near, self.near),
            np.where(no_far, other.far, self.far),
            np.where(no_near, other.error, self.error),
        )


def first_places(schedule: Schedule) -> tuple[float, ...]:
    """Return the places to look at for boundaries: the strike, and where the boundary begins before expiry."""
    for segment in reversed(schedule.segments):
        if segment.exercisable:
            near, _ = earning_region(segment, is_put=schedule.is_put).boundaries(schedule)
            if not math.isnan(near) and near / schedule.strike > 0.0 and near != schedule.strike:
                return 0.0, math.log(near / schedule.strike)
    return (0.0,)


def far_place(schedule: Schedule) -> float:
    """Return where the end further from the strike begins before expiry, in x; NaN where there is none."""
    region = region_at_expiry(schedule)
    far = region.lower if schedule.is_put else region.upper
    return far if region.lower <= region.upper and math.isfinite(far) else math.nan


def boundary_now(schedule: Schedule, found: ObstacleSolution, request: Request) -> float:
    """Return the exercise boundary now, money, of two the one nearer the strike; NaN where there is none."""
    if not schedule.segments[0].exercisable or found.march is None:
        return math.nan
    near = _near_now(schedule, found.march)
    left, right = found.march.grid.x[[0, -1]].tolist()
    for place in first_places(schedule):
        if math.isnan(near) and not left < place < right and not request.is_interrupted():
            there = replace(schedule, spot=schedule.strike * math.exp(place))
            other = solve(contract_problem(there), place, ELSEWHERE, interrupt=request.interrupt)
            near = math.nan if other.march is None else _near_now(schedule, other.march)
    return near


def _near_now(schedule: Schedule, march: March) -> float:
    near, _ = _two(schedule, _places(march, march.now.contacts[0]))
    return _money(schedule, schedule.segments[0], 0.0, near)


def coefficient_jumps(schedule: Schedule) -> tuple[float, ...]:
    """Return the ends of segments at which a curve jumps: from there on a boundary goes as the root of time."""
    segments = schedule.segments
    names = ("rate", "dividend_yield", "volatility", "exercisable")
    return tuple(
        before.end
        for before, after in pairwise(segments)
        if any(getattr(before, name) != getattr(after, name) for name in names)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """The boundaries of a solved contract on its two finest grids.

    Parameters
    ----------
    fine, coarse : Traced or None
        None where no such grid was finished.
    """

    fine: Traced | None
    coarse: Traced | None

    @classmethod
    def of(cls, schedule: Schedule, found: ObstacleSolution) -> Traces:
        """Trace the boundaries of a solution."""
        fine, coarse = (
            None if march is None else Traced.of(schedule, march) for march in (found.march, found.coarse)
        )
        return cls(fine, coarse)

    def at(self, times: Vector) -> Ends:
        """Return the ends of the exercise region at times, years from now, shape (m,).

        At a time at which something happens they are those just before it. The error is that of the end nearer the
        strike, and as large as this itself where the coarser grid has none.
        """
        nothing = np.full(times.size, math.nan)
        if self.fine is None:
            return Ends(nothing, nothing, nothing)
        own = self.fine.at(times)
        if self.coarse is None:
            return Ends(own[:, 0], own[:, 1], own[:, 0])
        around = np.maximum(times + np.outer(AROUND, self.fine.left_at(times)), 0.0).ravel()
        with np.errstate(invalid="ignore"):
            differences = np.abs(self.fine.at(around) - self.coarse.at(around))[:, 0]
        differences = differences.reshape(AROUND.size, -1)
        known = ~np.isnan(differences[0])
        error = SHARE * np.where(known, np.fmax.reduce(differences, axis=0), own[:, 0])
        return Ends(own[:, 0], own[:, 1], np.where(np.isnan(own[:, 0]), math.nan, error))


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """The boundaries between two times at neither of which anything happens, nor any coefficient jumps, in between.

    Parameters
    ----------
    start, end : float
        Years from now.
    roots : Vector, shape (k,)
        The roots of the times from the ends of the steps to `end`, increasing; with 0 where `at_end` has what the
        others have.
    known : Matrix, shape (k, 2)
        (near, far) there, in x.
    at_end : (float, float) or None
        Those just before `end`, in x, where something happens there.
    """

    start: float
    end: float
    roots: Vector
    known: Matrix
    at_end: tuple[float, float] | None

    def at(self, t: float) -> tuple[float, float]:
        """Return (near, far), in x, at a time of the piece."""
        if self.at_end is not None and t == self.end:
            return self.at_end
        if self.roots.size == 0:
            return math.nan, math.nan
        root = math.sqrt(max(self.end - t, 0.0))
        first = int(np.searchsorted(self.roots, root)) - POINTS // 2
        first = min(max(first, 0), max(self.roots.size - POINTS, 0))
        chosen = slice(first, first + POINTS)
        roots, known = self.roots[chosen], self.known[chosen]
        near, far = (_interpolated(roots, known[:, k], root) for k in range(2))
        return near, far


@dataclass(frozen=True, slots=True, eq=False)
class Traced:
    """The boundaries of one march.

    Parameters
    ----------
    schedule : Schedule
    pieces : tuple of Piece
        In the order of time.
    """

    schedule: Schedule
    pieces: tuple[Piece, ...]

    @classmethod
    def of(cls, schedule: Schedule, march: March) -> Traced:
        """Trace the boundaries of a march."""
        pieces = [piece for part in march.parts for piece in _pieces(schedule, march, part)]
        return cls(schedule, tuple(pieces[::-1]))

    def left_at(self, times: Vector) -> Vector:
        """Return the time from each of these to the end of its piece, shape (m,)."""
        return np.array([self._piece(t).end - t for t in times.tolist()])

    def at(self, times: Vector) -> Matrix:
        """Return (near, far) at times, money, shape (m, 2)."""
        found = np.full((times.size, 2), math.nan)
        for row, t in enumerate(times.tolist()):
            segment = next((s for s in self.schedule.segments if t <= s.end), self.schedule.segments[-1])
            found[row] = [_money(self.schedule, segment, t, x) for x in self._piece(t).at(t)]
        return found

    def _piece(self, t: float) -> Piece:
        return next((piece for piece in self.pieces if t <= piece.end), self.pieces[-1])


def _pieces(schedule: Schedule, march: March, part: SegmentMarch) -> list[Piece]:
    """Return the pieces of a segment, the last one first."""
    obstacle, start, end = march.problem.lower, part.segment.start, part.segment.end
    places = () if obstacle is None else held_before(part, obstacle, 1.0)
    breaks = [t for t in march.problem.diffusion.breaks if start < t < end]
    times, known = np.zeros(0), np.zeros((0, 2))
    if part.segment.acting[0] is not None:
        instants = part.instants[1:]
        times = np.array([instant.t for instant in instants])
        known = np.array([_two(schedule, _places(march, march.profile(one).contacts[0])) for one in instants])
    found = []
    edges = [end, *breaks[::-1], start]
    for late, early in pairwise(edges):
        own = (times >= early) & (times < late)
        at_end = _at_end(schedule, late, places) if late == end else None
        found.append(_piece(early, late, np.sqrt(late - times[own]), known[own], at_end))
    return found


def _at_end(schedule: Schedule, end: float, held: Intervals) -> tuple[float, float]:
    """Return (near, far) just before the end of a segment, in x; at expiry their limit."""
    last = schedule.segments[-1]
    if end < last.end or last.due > 0.0 or last.fraction > 0.0:
        # Rounding may hold a value of 0, which is not exercised.
        segment = next(s for s in schedule.segments if end <= s.end)
        kink = math.log(max(1.0 - segment.escrow_at(end) / schedule.strike, GONE))
        pays = [pair for pair in held if (pair[0] < kink if schedule.is_put else pair[1] > kink)]
        return _two(schedule, tuple(pays))
    region = region_at_expiry(schedule)
    return _two(schedule, ((region.lower, region.upper),) if region.lower <= region.upper else ())


def _piece(
    start: float, end: float, roots: Vector, known: Matrix, at_end: tuple[float, float] | None
) -> Piece:
    """Return a piece, to whose known boundaries those at the end belong where they are the same ones."""
    if at_end is not None and roots.size and (np.isnan(known[0]) | ~np.isnan(at_end)).all():
        joined = np.where(np.isnan(known[0]), math.nan, at_end)
        roots, known = np.append(0.0, roots), np.vstack([joined, known])
    return Piece(start, end, roots, known, at_end)


def _interpolated(roots: Vector, known: Vector, root: float) -> float:
    """Return the polynomial through what is known; the nearest one where something is not."""
    if not np.isfinite(known).all():
        return float(known[np.argmin(np.abs(roots - root))])
    found = 0.0
    for k in range(roots.size):
        others = np.delete(roots, k)
        found += float(known[k] * np.prod((root - others) / (roots[k] - others)))
    return found


def _places(march: March, contacts: Intervals) -> Intervals:
    """Return intervals of nodes as those of places, joined where less than `GAP` cells lie between two.

    A node that the end of a contact set passes within a step leaves such a gap. What comes as near to an end of the
    interval goes on beyond it.
    """
    last = march.grid.x.size - 1
    joined: list[tuple[float, float]] = []
    for left, right in contacts:
        begins = joined.pop()[0] if joined and left - joined[-1][1] < GAP else left
        joined.append((begins, right))
    return tuple(
        (
            -math.inf if left < GAP else _place(march, left),
            math.inf if right > last - GAP else _place(march, right),
        )
        for left, right in joined
    )


def _place(march: March, edge: float) -> float:
    return edge if math.isinf(edge) else float(march.grid.place(np.array([edge]))[0])


def _two(schedule: Schedule, intervals: Intervals) -> tuple[float, float]:
    """Return the end nearer the strike and the other one of the contact set next to the strike; NaN without one."""
    if not intervals:
        return math.nan, math.nan
    left, right = max(intervals) if schedule.is_put else min(intervals)
    near, far = (right, left) if schedule.is_put else (left, right)
    return near if math.isfinite(near) else math.nan, far if math.isfinite(far) else math.nan


def _money(schedule: Schedule, segment: Segment, t: float, place: float) -> float:
    """Return the quoted spot at a place."""
    if math.isnan(place):
        return math.nan
    spot = schedule.strike * math.exp(place) + segment.escrow_at(t)
    return spot if 0.0 < spot <= SPOT.most else math.nan
