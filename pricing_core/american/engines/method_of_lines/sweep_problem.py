"""What a solve at one resolution is asked, and what it answers."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.stage import LCPMethod
from pricing_core.american.engines.method_of_lines.tangents import Direction
from pricing_core.arrays import BoolVector, Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class SharedSweeps:
    """The sweeps of contracts that differ in the spot alone, in units of their strikes, on one range of spots.

    Parameters
    ----------
    spots : tuple of float
        S/K of every contract.
    found : dict
        Sweeps, or what they raised, by the key of their request.
    """

    spots: tuple[float, ...]
    found: dict[Hashable, Sweep | Exception] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class SweepRequest:
    """A solve from expiry to now that is wanted.

    Parameters
    ----------
    resolution : Resolution
        `steps` are those of an option without events; a segment has a share that goes like the root of its length.
    times : tuple of float
        Years from now, increasing: when to look at the exercise region; at the end of a segment just before the event.
    directions : tuple of Direction
        The parameters whose derivatives the kernel carries along.
    never_exercised : bool
        The European option with the same events is wanted.
    shared : SharedSweeps, optional
        Where equal sweeps for other contracts are kept.
    """

    schedule: Schedule
    grid: Grid
    resolution: Resolution
    lcp_method: LCPMethod = "tridiagonal"
    times: tuple[float, ...] = ()
    directions: tuple[Direction, ...] = ()
    never_exercised: bool = False
    shared: SharedSweeps | None = None

    @property
    def key(self) -> Hashable:
        """What settles the sweep: requests with equal keys, and strikes that make no difference, have one answer."""
        schedule = self.schedule
        directions = tuple((d.terms.tobytes(), d.surfaces, d.step) for d in self.directions)
        return (
            *(schedule.is_put, schedule.segments, schedule.local, directions, self.grid.nodes.tobytes()),
            *(self.resolution, self.lcp_method, self.times, self.never_exercised),
        )


@dataclass(frozen=True, slots=True)
class Part:
    """A segment, its number of steps, and when to look at the exercise region: years before its end, above 0."""

    segment: Segment
    steps: int
    wanted: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SweepProblem:
    """What is asked, and the parts that the schedule is solved in, from now to expiry."""

    request: SweepRequest
    parts: tuple[Part, ...]

    def has_the_parts_of(self, request: SweepRequest) -> bool:
        """Whether another sweep of the same schedule is solved in the same parts."""
        own = self.request
        same = own.schedule is request.schedule and own.resolution is request.resolution
        return same and own.times == request.times and own.directions is request.directions

    @property
    def schedule(self) -> Schedule:
        """The schedule that is solved."""
        return self.request.schedule

    @property
    def grid(self) -> Grid:
        """The grid in s = S/K that it is solved on."""
        return self.request.grid

    @property
    def resolution(self) -> Resolution:
        """The numbers of cells and steps, and the method."""
        return self.request.resolution

    @property
    def sign(self) -> float:
        """1 for a put, -1 for a call."""
        return 1.0 if self.schedule.is_put else -1.0

    @property
    def watched(self) -> tuple[float, ...]:
        """Where the operator's order matters: the strike and the spots, in strikes."""
        shared = self.request.shared
        spots = (self.schedule.spot / self.schedule.strike,) if shared is None else shared.spots
        return 1.0, *spots


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A schedule solved at one resolution, in units of the strike.

    Parameters
    ----------
    grid : Grid
    values : Vector, shape (N + 2,)
        Now, at the nodes.
    at_zero : float
        Now, at s = 0: exact.
    contact : BoolVector, shape (N,)
        The interior nodes in the exercise region now.
    region : ExerciseRegion
        In s = S/K (not its logarithm), of the spot that diffuses.
    regions : tuple of ExerciseRegion
        At the times asked for, likewise.
    steps : int
    residual : float
        Largest natural residual of the complementarity problems.
    fitted : bool
        See `spot_operator`.
    stored : int
        Largest number of numbers that were held in memory, to within a factor of two.
    tangents : Matrix, shape (P, N + 2), or None
        Derivatives of the values by the parameters; None where the march does not carry them.
    """

    grid: Grid
    values: Vector
    at_zero: float
    contact: BoolVector
    region: ExerciseRegion
    regions: tuple[ExerciseRegion, ...]
    steps: int
    residual: float
    fitted: bool
    stored: int = 0
    tangents: Matrix | None = None

    def holds_in_gap(self, s: float) -> bool:
        """Whether a node next to s in S/K is held between exercised ones, as a put may be before a large dividend."""
        exercised = np.flatnonzero(self.contact)
        above = int(self.grid.interior.searchsorted(s))
        next_to = (above - 1, above)
        return any(exercised[0] < k < exercised[-1] and not self.contact[k] for k in next_to)


@dataclass(frozen=True, slots=True)
class SegmentRegions:
    """The exercise regions seen in one segment: before the event at its end, at the times asked for, at its start."""

    before_event: ExerciseRegion
    wanted: Sequence[ExerciseRegion]
    at_start: ExerciseRegion


def regions_at(
    times: tuple[float, ...], schedule: Schedule, seen: Sequence[SegmentRegions]
) -> tuple[ExerciseRegion, ...]:
    """Return the regions at these years from now, at the end of a segment that just before the event."""
    found: dict[float, ExerciseRegion] = {}
    following = EMPTY_REGION
    for segment, regions in zip(reversed(schedule.segments), reversed(seen), strict=True):
        pays = segment.fraction > 0.0 or segment.due > 0.0
        before = regions.before_event if pays or not segment.exercisable else following
        found.update((t, before) for t in times if t == segment.end)
        inside = [t for t in times if segment.start <= t < segment.end]
        found.update(zip(inside, regions.wanted, strict=True))
        following = regions.at_start
    return tuple(found.get(t, EMPTY_REGION) for t in times)
