"""Exercise boundaries over time, from the contact sets at the ends of the steps of a solved contract."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.american.contracts.fields import SPOT
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import (
    ExerciseRegion,
    limits_before_expiry,
    region_at_expiry,
)
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


class _Part(Protocol):
    """A part of the life of an option."""

    @property
    def end(self) -> float:
        """Years from now."""


Part = TypeVar("Part", bound=_Part)


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

    def with_limit(self, book: Book, times: Vector) -> Ends:
        """Return these ends with the limit at expiry, where this is among the times and nothing is paid then."""
        limit, at_expiry = limit_at_expiry(book), times >= book.expiry
        if limit is None:
            return self
        near, far = limit.boundaries(book.strike.item(), is_put=book.is_put.item())
        return Ends(
            np.where(at_expiry, near, self.near),
            np.where(at_expiry, far, self.far),
            np.where(at_expiry, 0.0, self.error),
        )


def first_places(book: Book) -> tuple[float, ...]:
    """Return the places to look at for boundaries: the strike, and where the boundary begins before expiry."""
    moneyness = (limits_before_expiry(book) / book.strike).item()
    return (0.0, math.log(moneyness)) if moneyness > 0.0 else (0.0,)


def _far_place(book: Book) -> float:
    """Return where the end further from the strike begins before expiry, in x; NaN where there is none."""
    is_put = book.is_put.item()
    region = region_at_expiry(book.segments_of()[-1], is_put=is_put)
    far = region.lower if is_put else region.upper
    return far if region.lower <= region.upper and math.isfinite(far) else math.nan


def limit_at_expiry(book: Book) -> ExerciseRegion | None:
    """Return the limit of the exercise region of one contract before expiry; None where a dividend is paid then."""
    last = book.segments_of()[-1]
    pays = last.due > 0.0 or last.fraction > 0.0
    return None if pays else region_at_expiry(last, is_put=book.is_put.item())


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
        nothing = np.full(times.size, math.nan)
        best, is_solved = Ends(nothing, nothing, nothing), False
        places = first_places(self.book)
        for place in (*places, _far_place(self.book)):
            ends = best.near if place in places else best.far
            if math.isnan(place) or not np.isnan(ends).any():
                continue
            traces = self._traces(place)
            if traces is not None:
                best, is_solved = best.completed_by(traces.at(times)), True
        best = best.with_limit(self.book, times)
        return Boundaries(best.near, best.far, best.error, np.full(times.size, is_solved))

    def _traces(self, place: float) -> Traces | None:
        """Return the boundaries of the solve around a place, ln(S/K) of the spot that diffuses."""
        if place not in self._found:
            tolerance = np.maximum(BOUNDARY_SHARE * self.request.tolerance, LEAST_TOLERANCE)
            own = replace(self.request, tolerance=tolerance, greeks="none")
            self._found[place] = self.solved(self.book.diffusing_at(self.book.strike * math.exp(place)), own)
        return self._found[place]


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """The boundaries of a solved contract on its two finest grids.

    Parameters
    ----------
    book : Book
        The contract alone.
    fine, coarse : tuple of Piece, in the order of time
        Without any where no such grid was finished.
    """

    book: Book
    fine: tuple[Piece, ...]
    coarse: tuple[Piece, ...]

    def at(self, times: Vector) -> Ends:
        """Return the ends of the exercise region at times, years from now, shape (m,).

        At a time at which something happens they are those just before it. The error is that of the end nearer the
        strike: as large as this itself where the coarser grid has none or where it comes or goes between the ends of a
        step, and at least by what it may move unseen.
        """
        nothing = np.full(times.size, math.nan)
        if not self.fine:
            return Ends(nothing, nothing, nothing)
        around = np.empty((len(AROUND) + 2, times.size))
        for piece, rows in _by_end(self.fine, times):
            around[:, rows] = piece.around(times[rows])
        with np.errstate(invalid="ignore"):
            fine, coarse = (self._money(pieces, around.ravel()) for pieces in (self.fine, self.coarse))
        differences, own = np.abs(fine - coarse)[:, 0].reshape(around.shape), fine[: times.size]
        known = ~np.isnan(differences[0])
        error = (
            SHARE * np.where(known, np.fmax.reduce(differences, axis=0), own[:, 0]) + UNSEEN_SHARE * own[:, 2]
        )
        return Ends(
            own[:, 0], own[:, 1], np.where(np.isnan(own[:, 0]), math.nan, np.minimum(error, own[:, 0]))
        )

    def _money(self, pieces: tuple[Piece, ...], times: Vector) -> Matrix:
        """Return (near, far) at times, and how far the former may move unseen, money, shape (m, 3)."""
        found = np.full((times.size, 3), math.nan)
        for piece, rows in _by_end(pieces, times):
            found[rows] = piece.at(times[rows])
        for segment, rows in _by_end(self.book.segments_of(), times):
            found[rows, :2] = quoted(self.book.strike.item(), segment, times[rows, None], found[rows, :2])
        found[:, 2] *= found[:, 0]
        return found


def _by_end(parts: Sequence[Part], times: Vector) -> Iterator[tuple[Part, NDArray[np.intp]]]:
    """Yield the parts of a life in order, and which of the times lie in each: up to its end, all others in the last."""
    if parts:
        of_times = np.searchsorted([part.end for part in parts[:-1]], times)
        for number in np.unique(of_times).tolist():
            yield parts[number], np.flatnonzero(of_times == number)


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
        book: Book,
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
        at_end = (held[0], held[1], held[2])
        if end >= book.expiry.item() and (limit := limit_at_expiry(book)) is not None:
            at_end = (*ends_of(limit.lower, limit.upper, is_put=book.is_put.item()), 0.0)
        # Where the boundary stays at a node the last time is nearest to when it leaves it.
        stays = (known[:-1, 2] > 0.0) & (known[:-1, 0] == known[1:, 0])
        moves = np.append(~stays, True)[: times.size]
        roots, known = np.sqrt(end - times[moves]), known[moves]
        if roots.size and (np.isnan(known[0]) | ~np.isnan(at_end)).all():
            joined = np.where(np.isnan(known[0]), math.nan, at_end)
            roots, known = np.append(0.0, roots), np.vstack([joined, known])
        return cls(start, end, roots, known, at_end)

    def around(self, times: Vector) -> Matrix:
        """Return times around each of the piece, itself the first, at which resolutions are compared, (8, m)."""
        left = self.end - times
        known = np.stack([times, times])
        if self.roots.size:
            known = self.end - self.roots[self._beside(times, 2)[:, [0, -1]].T] ** 2
        return np.vstack([np.maximum(times + AROUND[:, None] * left, 0.0), known])

    def at(self, times: Vector) -> Matrix:
        """Return (near, far), in x, at times of the piece, and how far the former may move unseen, shape (m, 3)."""
        found = np.full((times.size, 3), math.nan)
        if self.roots.size:
            roots, chosen = np.sqrt(np.maximum(self.end - times, 0.0)), self._beside(times, POINTS)
            for k in range(2):
                found[:, k] = _interpolated(self.roots[chosen], self.known[chosen, k], roots)
            beside = self._beside(times, 2)
            found[:, 2] = self.known[beside, 2].max(axis=1)
            # Where it comes or goes between the ends of a step nothing tells how far it is by then.
            gone = np.isnan(self.known[beside, 0]).any(axis=1) & ~np.isin(roots, self.roots)
            found[gone, 2] = math.inf
        else:
            found[:, 2] = 0.0
        found[times == self.end] = self.at_end
        return found

    def _beside(self, times: Vector, count: int) -> NDArray[np.intp]:
        """Return which of the roots are so many around those of times, shape (m, count) or all of them."""
        first = np.searchsorted(self.roots, np.sqrt(np.maximum(self.end - times, 0.0))) - count // 2
        first = np.minimum(np.maximum(first, 0), max(self.roots.size - count, 0))
        return np.asarray(first[:, None] + np.arange(min(count, self.roots.size)))


def _interpolated(roots: Matrix, known: Matrix, at: Vector) -> Vector:
    """Return at (m,) roots the polynomials through (m, k) known values; the nearest one where something is not."""
    found = np.zeros(at.size)
    for j in range(roots.shape[1]):
        others = np.delete(roots, j, axis=1)
        weight = np.prod((at[:, None] - others) / (roots[:, j : j + 1] - others), axis=1)
        found += weight * known[:, j]
    nearest = np.abs(roots - at[:, None]).argmin(axis=1)
    return np.where(np.isfinite(known).all(axis=1), found, known[np.arange(at.size), nearest])


def ends_of(lower: float, upper: float, *, is_put: bool) -> tuple[float, float]:
    """Return the end nearer the strike and the other one of an interval of places; NaN without one."""
    if lower > upper:
        return math.nan, math.nan
    near, far = (upper, lower) if is_put else (lower, upper)
    return near if math.isfinite(near) else math.nan, far if math.isfinite(far) else math.nan


def quoted(strike: float, segment: Segment, times: Matrix | float, places: Matrix | float) -> Matrix:
    """Return the quoted spots at places and times of a segment, money; NaN where there is none."""
    years = np.maximum(segment.end - times, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        spot = strike * np.exp(places) + segment.escrow * np.exp(-segment.rate * years)
        return np.where((spot > 0.0) & (spot <= SPOT.most), spot, math.nan)
