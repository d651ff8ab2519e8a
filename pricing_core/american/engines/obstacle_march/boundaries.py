"""Exercise boundaries over time, from the contact sets at the ends of the steps of a solved contract."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import SPOT
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import earning_region, region_at_expiry
from pricing_core.arrays import Matrix, Vector

POINTS = 4  # of the polynomials in the root of time through a boundary at the ends of steps
# Two resolutions may agree by chance at one time: they are compared at others as well, the ends of the step that holds
# it, and these shares of the time to a piece's end later; chosen.
AROUND = np.array([0.0, -0.15, -0.05, 0.05, 0.15, 0.3])
# Errors of a boundary over the difference of two resolutions, and over how far it may move unseen; calibrated.
SHARE, UNSEEN_SHARE = 1.25, 0.25
# Tolerance of a solve that boundaries are wanted of over what is asked of a price, and the least one, in strikes;
# chosen.
BOUNDARY_SHARE, LEAST_TOLERANCE = 0.01, 1e-8


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


@dataclass(slots=True, eq=False)
class BoundariesOf:
    """Both boundaries of one contract at any times, from one solve, or a few where they begin far from the strike.

    The contract is solved around a place where it is asked first, and only once.

    Parameters
    ----------
    book : Book
        A book of one contract.
    request : Request
    solved : callable
        Takes a book of one contract, whose spot is where the boundary is looked for, and a request, and returns the
        `Traces`; None where the contract cannot be solved there.
    """

    book: Book
    request: Request
    solved: Callable[[Book, Request], Traces | None]
    _found: dict[float, Traces | None] = field(init=False, default_factory=dict)

    def __call__(self, times: Vector) -> Boundaries:
        """Return them at times, years from now, shape (m,)."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            return self._at(times)

    def _at(self, times: Vector) -> Boundaries:
        schedule = self.book.schedule(0)
        nothing = np.full(times.size, math.nan)
        best, is_solved = Ends(nothing, nothing, nothing), False
        places = first_places(schedule)
        for place in (*places, far_place(schedule)):
            ends = best.near if place in places else best.far
            if math.isnan(place) or not np.isnan(ends).any():
                continue
            traces = self._traces(place)
            if traces is not None:
                best, is_solved = best.completed_by(traces.at(times)), True
        last = schedule.segments[-1]
        at_expiry = times >= last.end
        if at_expiry.any() and not (last.due > 0.0 or last.fraction > 0.0):
            near, far = region_at_expiry(schedule).boundaries(schedule)
            best.near[at_expiry], best.far[at_expiry], best.error[at_expiry] = near, far, 0.0
        return Boundaries(best.near, best.far, best.error, np.full(times.size, is_solved))

    def _traces(self, place: float) -> Traces | None:
        """Return the boundaries of the solve around a place, ln(S/K) of the spot that diffuses."""
        if place not in self._found:
            spot = self.book.strike * math.exp(place) + self.book.escrow_now()
            tolerance = np.maximum(BOUNDARY_SHARE * self.request.tolerance, LEAST_TOLERANCE)
            own = replace(self.request, tolerance=tolerance, greeks="none")
            self._found[place] = self.solved(replace(self.book, spot=spot), own)
        return self._found[place]


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """The boundaries of a solved contract on its two finest grids.

    Parameters
    ----------
    schedule : Schedule
    fine, coarse : tuple of Piece, in the order of time
        Without any where no such grid was finished.
    """

    schedule: Schedule
    fine: tuple[Piece, ...]
    coarse: tuple[Piece, ...]

    def at(self, times: Vector) -> Ends:
        """Return the ends of the exercise region at times, years from now, shape (m,).

        At a time at which something happens they are those just before it. The error is that of the end nearer the
        strike: as large as this itself where the coarser grid has none, and at least by what it may move unseen.
        """
        nothing = np.full(times.size, math.nan)
        if not self.fine:
            return Ends(nothing, nothing, nothing)
        around = np.array([_piece_at(self.fine, t).around(t) for t in times.tolist()]).T
        with np.errstate(invalid="ignore"):
            fine, coarse = (self._money(pieces, around.ravel()) for pieces in (self.fine, self.coarse))
        differences, own = np.abs(fine - coarse)[:, 0].reshape(around.shape), fine[: times.size]
        known = ~np.isnan(differences[0])
        error = (
            SHARE * np.where(known, np.fmax.reduce(differences, axis=0), own[:, 0]) + UNSEEN_SHARE * own[:, 2]
        )
        return Ends(own[:, 0], own[:, 1], np.where(np.isnan(own[:, 0]), math.nan, error))

    def _money(self, pieces: tuple[Piece, ...], times: Vector) -> Matrix:
        """Return (near, far) at times, and how far the former may move unseen, money, shape (m, 3)."""
        found = np.full((times.size, 3), math.nan)
        segments = self.schedule.segments
        for row, t in enumerate(times.tolist() if pieces else ()):
            segment = next((s for s in segments if t <= s.end), segments[-1])
            *ends, unseen = _piece_at(pieces, t).at(t)
            near, far = (quoted(self.schedule, segment, t, x) for x in ends)
            found[row] = near, far, near * unseen
        return found


def _piece_at(pieces: tuple[Piece, ...], t: float) -> Piece:
    return next((piece for piece in pieces if t <= piece.end), pieces[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """The boundaries between two times, between which nothing happens and no coefficient jumps.

    Parameters
    ----------
    start, end : float
        Years from now.
    roots : Vector, shape (k,)
        The roots of the times from the ends of the steps to `end`, increasing; with 0 where `at_end` has what the
        others have.
    known : Matrix, shape (k, 3)
        (near, far) there, in x, and how far the former may move unseen.
    at_end : (float, float, float)
        The same just before `end`.
    """

    start: float
    end: float
    roots: Vector
    known: Matrix
    at_end: tuple[float, float, float]

    @classmethod
    def of(
        cls,
        schedule: Schedule,
        span: tuple[float, float],
        times: Vector,
        known: Matrix,
        held: tuple[float, ...],
    ) -> Piece:
        """Return the boundaries over a span, given those at decreasing times and those just before its end.

        At expiry these are the limit, unless a dividend is paid there. They belong to the others where they are the
        same boundaries.
        """
        start, end = span
        last = schedule.segments[-1]
        at_end = (held[0], held[1], held[2])
        if end >= last.end and not (last.due > 0.0 or last.fraction > 0.0):
            region = region_at_expiry(schedule)
            at_end = (*ends_of(schedule, region.lower, region.upper), 0.0)
        # Where the boundary stays at a node the last time is nearest to when it leaves it.
        stays = (known[:-1, 2] > 0.0) & (known[:-1, 0] == known[1:, 0])
        moves = np.append(~stays, True)[: times.size]
        roots, known = np.sqrt(end - times[moves]), known[moves]
        if roots.size and (np.isnan(known[0]) | ~np.isnan(at_end)).all():
            joined = np.where(np.isnan(known[0]), math.nan, at_end)
            roots, known = np.append(0.0, roots), np.vstack([joined, known])
        return cls(start, end, roots, known, at_end)

    def around(self, t: float) -> list[float]:
        """Return times around one of the piece, itself the first, at which resolutions are compared."""
        left = self.end - t
        known = (
            np.full(2, t) if self.roots.size == 0 else self.end - self.roots[self._beside(t, 2)][[0, -1]] ** 2
        )
        return [*np.maximum(t + AROUND * left, 0.0).tolist(), *known.tolist()]

    def at(self, t: float) -> tuple[float, float, float]:
        """Return (near, far), in x, at a time of the piece, and how far the former may move unseen."""
        if t == self.end:
            return self.at_end
        if self.roots.size == 0:
            return math.nan, math.nan, 0.0
        root, chosen = math.sqrt(max(self.end - t, 0.0)), self._beside(t, POINTS)
        near, far = (_interpolated(self.roots[chosen], self.known[chosen, k], root) for k in range(2))
        return near, far, float(self.known[self._beside(t, 2), 2].max())

    def _beside(self, t: float, count: int) -> slice:
        """Return which of the roots are so many around that of a time."""
        first = int(np.searchsorted(self.roots, math.sqrt(max(self.end - t, 0.0)))) - count // 2
        first = min(max(first, 0), max(self.roots.size - count, 0))
        return slice(first, first + count)


def _interpolated(roots: Vector, known: Vector, root: float) -> float:
    """Return the polynomial through what is known; the nearest one where something is not."""
    if not np.isfinite(known).all():
        return float(known[np.argmin(np.abs(roots - root))])
    found = 0.0
    for k in range(roots.size):
        others = np.delete(roots, k)
        found += float(known[k] * np.prod((root - others) / (roots[k] - others)))
    return found


def ends_of(schedule: Schedule, lower: float, upper: float) -> tuple[float, float]:
    """Return the end nearer the strike and the other one of an interval of places; NaN without one."""
    if lower > upper:
        return math.nan, math.nan
    near, far = (upper, lower) if schedule.is_put else (lower, upper)
    return near if math.isfinite(near) else math.nan, far if math.isfinite(far) else math.nan


def quoted(schedule: Schedule, segment: Segment, t: float, place: float) -> float:
    """Return the quoted spot at a place, money; NaN where there is none."""
    if math.isnan(place):
        return math.nan
    spot = schedule.strike * math.exp(place) + segment.escrow_at(t)
    return spot if 0.0 < spot <= SPOT.most else math.nan
