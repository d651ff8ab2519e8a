"""The exercise region in the logarithm of the spot that diffuses, as the march over the segments asks for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from pricing_core.american.book.segments import Segment
from pricing_core.american.boundary import JUST_AFTER, ExerciseBoundary
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError

SCANNED = 32  # Number of times of a segment at which it is asked whether there is a region; chosen.
UNKNOWN_ERROR = 1e-4  # Error of a boundary that tells none, as a share of it; chosen.
REFINED, REFINEMENTS = (
    16,
    3,
)  # Numbers of times, and of rounds, that narrow down where it begins or ends; chosen.

Boundaries: TypeAlias = Callable[[Vector], ExerciseBoundary]


def parameters(count: int) -> Vector:
    """Return the points of an even mesh from 0 to 1, shape (count + 1,)."""
    return np.linspace(0.0, 1.0, count + 1)


def times_in(start: float, end: float, parameter: Vector) -> Vector:
    """Return times between two, dense at both."""
    return np.clip(start + (end - start) * np.sin(0.5 * np.pi * parameter) ** 2, start, end)


def monotone_cubic(values: Vector) -> Callable[[Vector], Vector]:
    """Return the monotone cubic through values at the points of an even mesh from 0 to 1."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  a price does without it

    interpolated: Callable[[Vector], Vector] = PchipInterpolator(parameters(values.size - 1), values)
    return interpolated


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Where exercise is optimal at one time: between two places, -inf and inf where there is no such end.

    Parameters
    ----------
    low, high : float
        In ln(spot).
    error : float
        Estimated error of both, in ln(spot).
    """

    low: float
    high: float
    error: float

    def moved(self, errors: float) -> Region:
        """Return the region with both ends moved by so many of its errors."""
        by = errors * self.error
        return Region(self.low + by, self.high + by, self.error)


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """A part of a segment in which there is a region all the time, or none at all.

    Parameters
    ----------
    start, end : float
        Years from now.
    low, high : callable or None
        Ends of the region over the parameter of a mesh that is dense at both ends; None where there is no such end.
    error : callable or None
        Estimated error of the ends, in ln(spot), over the same; None where there is no region.
    """

    start: float
    end: float
    low: Callable[[Vector], Vector] | None = None
    high: Callable[[Vector], Vector] | None = None
    error: Callable[[Vector], Vector] | None = None

    @property
    def exists(self) -> bool:
        """Whether there is a region."""
        return self.low is not None or self.high is not None

    def region_at(self, parameter: float) -> Region:
        """Return the region at one point of the mesh."""
        place = np.array([parameter])
        low = -math.inf if self.low is None else float(self.low(place)[0])
        high = math.inf if self.high is None else float(self.high(place)[0])
        return Region(low, high, 0.0 if self.error is None else float(self.error(place)[0]))

    def edge(self, *, above: bool, errors: float) -> Callable[[Vector], Vector]:
        """Return the upper or the lower end of the region, moved by so many of its errors.

        Raises
        ------
        NumericalError
            There is no such end.
        """
        edge, error = self.high if above else self.low, self.error
        if edge is None or error is None:
            raise NumericalError("nobody stands on the open side of an exercise region")
        return lambda parameter: edge(parameter) + errors * error(parameter)


@dataclass(frozen=True, slots=True, eq=False)
class RegionFinder:
    """Asks for the boundaries of a contract and gives them as regions.

    Parameters
    ----------
    boundaries : callable
        Takes increasing times and returns an `ExerciseBoundary`.
    count : int
        Number of intervals of the mesh of a span.
    is_put : bool
    """

    boundaries: Boundaries
    count: int
    is_put: bool

    def at_end(self, segment: Segment) -> Region | None:
        """Return the region just before what happens at the end of a segment; None where there is none."""
        found = self.boundaries(np.array([segment.end]))
        near, far, error = self._logarithms(segment, found)
        if math.isnan(near[0]):
            return None
        low, high = (far[0], near[0]) if self.is_put else (near[0], far[0])
        return Region(
            -math.inf if math.isnan(low) else low, math.inf if math.isnan(high) else high, float(error[0])
        )

    def spans(self, segment: Segment) -> list[Span]:
        """Return the spans of a segment in which exercise is allowed, in the order of time."""
        times = self._inside(segment.start, segment.end, parameters(SCANNED)[:-1])
        exists = ~np.isnan(self._near(segment, times))
        cuts = [segment.start]
        kinds = [bool(exists[0])]
        for i in np.flatnonzero(exists[1:] != exists[:-1]).tolist():
            cuts.append(self._change(segment, times[i].item(), times[i + 1].item(), first=bool(exists[i])))
            kinds.append(bool(exists[i + 1]))
        cuts.append(segment.end)
        pairs = zip(pairwise(cuts), kinds, strict=True)
        return [
            self._followed(segment, start, end) if kind else Span(start, end) for (start, end), kind in pairs
        ]

    def _change(self, segment: Segment, low: float, high: float, *, first: bool) -> float:
        """Return when the region ends (first) or begins."""
        for _ in range(REFINEMENTS):
            times = np.linspace(low, high, REFINED + 1)
            same = ~np.isnan(self._near(segment, times[1:-1])) == first
            place = int(np.argmin(same)) if not same.all() else same.size
            low, high = times[place].item(), times[place + 1].item()
        return 0.5 * (low + high)

    def _followed(self, segment: Segment, start: float, end: float) -> Span:
        """Return the span with the ends of its region as monotone cubics between the points of the mesh."""
        mesh = parameters(self.count)
        found = self.boundaries(self._inside(start, end, mesh))
        near, far, error = self._logarithms(segment, found)
        near_edge = monotone_cubic(_filled(near))
        far_edge = None if np.isnan(far).all() else monotone_cubic(_filled(far))
        low, high = (far_edge, near_edge) if self.is_put else (near_edge, far_edge)
        return Span(start, end, low, high, monotone_cubic(_filled(error)))

    def _inside(self, start: float, end: float, mesh: Vector) -> Vector:
        """Return the times of a mesh, the first one just after what happens at the start."""
        times = times_in(start, end, mesh)
        if start > 0.0:
            times[0] = start + JUST_AFTER * (end - start) * np.sin(0.5 * np.pi * mesh[1]) ** 2
        return times

    def _near(self, segment: Segment, times: Vector) -> Vector:
        return self._logarithms(segment, self.boundaries(times))[0]

    def _logarithms(self, segment: Segment, found: ExerciseBoundary) -> tuple[Vector, Vector, Vector]:
        """Return both ends in ln(spot) and the error of the near one, NaN where there is none."""
        escrow = np.array([segment.escrow_at(time) for time in found.time.tolist()])
        nothing = np.full(found.time.size, math.nan)
        ends: Sequence[Vector] = (
            found.boundary,
            nothing if found.other_boundary is None else found.other_boundary,
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            near, far = (np.where(end > escrow, np.log(end - escrow), math.nan) for end in ends)
            errors = np.log1p(found.error_estimate / (found.boundary - escrow))
        told = np.where(np.isnan(errors), UNKNOWN_ERROR, errors)
        return near, far, np.where(np.isnan(near), math.nan, told)


def _filled(values: Vector) -> Vector:
    """Return the values with the nearest one in the place of each NaN."""
    known = np.flatnonzero(~np.isnan(values))
    return np.asarray(np.interp(np.arange(values.size), known, values[known]))
