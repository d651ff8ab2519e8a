"""Exercise boundaries from the contact sets of a solved contract."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.contracts.fields import SPOT
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.exercise_region import earning_region
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem
from pricing_core.arrays import Vector
from pricing_core.obstacle import ObstacleSolution, solve
from pricing_core.obstacle.march import March, SegmentMarch
from pricing_core.obstacle.profile import Intervals
from pricing_core.obstacle.solution import held_before

POINTS = 4  # of the polynomials in the root of time through a boundary at the ends of steps
AROUND = np.array([0.0, 0.04, 0.09])  # Shares of the time to a segment's end, see `ends_at`; chosen.
SHARE = 1.5  # Error of a boundary over the difference of two resolutions; calibrated.
# Tolerance of a solve that is asked where the boundary is, in strikes, where the price's own has not met it; chosen.
ELSEWHERE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """The ends of the exercise region at m times, money: the one nearer the strike with its error, and the other."""

    near: Vector
    far: Vector
    error: Vector

    def completed_by(self, other: Ends) -> Ends:
        """Return these ends, with those of another solve where there are none."""
        none = np.isnan(self.near)
        pairs = ((self.near, other.near), (self.far, other.far), (self.error, other.error))
        return Ends(*(np.where(none, its, mine) for mine, its in pairs))


def first_places(schedule: Schedule) -> tuple[float, ...]:
    """Return the places to look at for boundaries: the strike, and where the boundary begins before expiry."""
    for segment in reversed(schedule.segments):
        if segment.exercisable:
            near, _ = earning_region(segment, is_put=schedule.is_put).boundaries(schedule)
            if not math.isnan(near) and near / schedule.strike > 0.0 and near != schedule.strike:
                return 0.0, math.log(near / schedule.strike)
    return (0.0,)


def boundary_now(schedule: Schedule, found: ObstacleSolution, request: Request) -> float:
    """Return the exercise boundary now, money, of two the one nearer the strike; NaN where there is none."""
    now = np.zeros(1)
    if not schedule.segments[0].exercisable or found.march is None:
        return math.nan
    near = float(ends_at(schedule, found, now).near[0])
    left, right = found.march.grid.x[[0, -1]].tolist()
    for place in first_places(schedule):
        if math.isnan(near) and not left < place < right and not request.is_interrupted():
            there = replace(schedule, spot=schedule.strike * math.exp(place))
            other = solve(contract_problem(there), place, ELSEWHERE, interrupt=request.interrupt)
            near = float(ends_at(schedule, other, now).near[0])
    return near


def ends_at(schedule: Schedule, found: ObstacleSolution, times: Vector) -> Ends:
    """Return the ends of the exercise region at times, years from now, shape (m,).

    At a time at which something happens they are those just before it.
    """
    nothing = np.full(times.size, math.nan)
    if found.march is None:
        return Ends(nothing, nothing, nothing)
    # Two resolutions may agree by chance at one time: they are compared at some later ones as well.
    ends = np.array([segment.end for segment in schedule.segments])
    left = ends[np.minimum(np.searchsorted(ends, times), ends.size - 1)] - times
    around = (times + np.outer(AROUND, left)).ravel()
    fine = _of_march(schedule, found.march, around)
    coarse = fine if found.coarse is None else _of_march(schedule, found.coarse, around)
    with np.errstate(invalid="ignore"):
        differences = np.abs(fine[:, 0] - coarse[:, 0]).reshape(AROUND.size, -1)
    own = fine[: times.size]
    error = np.where(np.isnan(own[:, 0]), math.nan, np.nanmax(differences, axis=0, initial=0.0))
    return Ends(own[:, 0], own[:, 1], SHARE * error)


def _of_march(schedule: Schedule, march: March, times: Vector) -> Vector:
    """Return (near, far) at times, money, shape (m, 2)."""
    ends = np.full((times.size, 2), math.nan)
    parts = march.parts[::-1]
    for row, t in enumerate(times.tolist()):
        part = next((part for part in parts if t <= part.segment.end), parts[-1])
        segment = next((s for s in schedule.segments if t <= s.end), schedule.segments[-1])
        if t == part.segment.end:
            obstacle = march.problem.lower
            places = () if obstacle is None else held_before(part, obstacle, 1.0)
            found = _two(schedule, places)
        else:
            found = _between(schedule, march, part, t)
        ends[row] = [_money(schedule, segment, t, place) for place in found]
    return ends


def _between(schedule: Schedule, march: March, part: SegmentMarch, t: float) -> tuple[float, float]:
    """Return (near, far) inside a segment, as places: polynomials in the root of the time to its end."""
    obstacle = part.segment.acting[0]
    if obstacle is None:
        return math.nan, math.nan
    end = part.segment.end
    roots = np.sqrt([max(end - instant.t, 0.0) for instant in part.instants])
    root, wanted = math.sqrt(end - t), part.instants
    above = min(max(int(np.searchsorted(roots, root)), 1), len(wanted) - 1)
    first = min(max(above - POINTS // 2, 1), max(len(wanted) - POINTS, 1))
    chosen = range(first, min(first + POINTS, len(wanted)))
    profiles = [march.profile(wanted[k]) for k in chosen]
    known = np.array([_two(schedule, _places(march, profile.contacts[0])) for profile in profiles])
    return tuple(_interpolated(roots[list(chosen)], known[:, k], root) for k in range(2))  # type: ignore[return-value]


def _interpolated(roots: Vector, known: Vector, root: float) -> float:
    """Return the polynomial through what is known; the nearest one where something is not."""
    if np.isfinite(known).all():
        return (
            float(np.polynomial.Polynomial.fit(roots, known, roots.size - 1)(root))
            if roots.size > 1
            else float(known[0])
        )
    return float(known[np.argmin(np.abs(roots - root))])


def _places(march: March, contacts: Intervals) -> Intervals:
    """Return intervals of nodes as those of places."""
    return tuple(
        tuple(  # type: ignore[misc]
            edge if math.isinf(edge) else float(march.grid.place(np.array([edge]))[0]) for edge in pair
        )
        for pair in contacts
    )


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
