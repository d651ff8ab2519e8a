"""The march from the horizon to now: segments between events, steps that grow as squares, stages."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError
from pricing_core.march_settings import (
    CLOCK_SHARE,
    FEWEST_PIECES,
    PIECES,
    PIECES_OF_TURNS,
    ROUNDED,
    SHORTEST,
    STEPS,
)
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.moment import PLACE_STEP, ROUNDING, Complementarity, Moment, Segment
from pricing_core.obstacle.problem import ObstacleProblem, just_before
from pricing_core.obstacle.profile import Profile, contact_sets
from pricing_core.obstacle.stage import StageSystem, Values, solve_stage
from pricing_core.obstacle.transfer import Known, Start, before, payoff_of
from pricing_core.stepping import ESDIRK3, SDIRK3, Tableau
from pricing_core.stepping.implicit import take_step

UNRESOLVED = 0.2  # of a kink's error that a polynomial over a cell may leave; calibrated
MOST_STEPS = 1e7  # Largest number of steps of a segment; chosen.
Mesh: TypeAlias = list[tuple[float, float, bool]]


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The values at the end of a step.

    Parameters
    ----------
    t : float
        Years from now.
    moment : Moment
        The equation at that time.
    values : Values
    """

    t: float
    moment: Moment
    values: Values


@dataclass(frozen=True, slots=True, eq=False)
class StageTaken:
    """One stage: V = base + a (L V + f + u - w) at the time t."""

    t: float
    a: float
    base: Vector
    values: Values


@dataclass(frozen=True, slots=True, eq=False)
class StepTaken:
    """One step of h years, and its implicit stages."""

    tableau: Tableau
    h: float
    stages: tuple[StageTaken, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SegmentMarch:
    """The march through one segment.

    Parameters
    ----------
    segment : Segment
    known : Known
        The value at the segment's end, before anything that happens there.
    start : Start
    steps : tuple of StepTaken
    instants : tuple of Instant
        The end of the segment and of each step.
    first : Profile
        The value just after the segment's beginning.
    """

    segment: Segment
    known: Known
    start: Start
    steps: tuple[StepTaken, ...]
    instants: tuple[Instant, ...]
    first: Profile

    @property
    def mesh(self) -> Mesh:
        """The steps as `time_mesh` tells them."""
        ends = [self.segment.end, *(instant.t for instant in self.instants[1:])]
        return [
            (early, late, step.tableau is ESDIRK3)
            for (late, early), step in zip(pairwise(ends), self.steps, strict=True)
        ]

    @property
    def unresolved(self) -> float:
        """What kinks of the value at the segment's end may cost now that it does not smooth over a cell, money.

        The next segment starts from values between nodes whose polynomials do not see such a kink. Its error is the
        jump of the slope times a cell, over a cell's width: what that is worth now is what a mass there is.
        """
        segment, grid = self.segment, self.segment.grid
        if segment.start == 0.0 or self.known.kinks.size == 0:
            return 0.0
        index = grid.index(self.known.kinks)
        index = index[(index > 1.0) & (index < grid.x.size - 2.0)]
        before, at, after = (
            self.known.value(grid.place(index + side)) for side in (-PLACE_STEP, 0.0, PLACE_STEP)
        )
        jump = np.abs(before - 2.0 * at + after) / PLACE_STEP
        diffusion = 2.0 * segment.transport(just_before(segment.end))[0][np.round(index).astype(int)]
        seen = np.exp(-0.5 * math.pi**2 * diffusion * segment.duration)
        return float(UNRESOLVED * (jump * seen / np.sqrt(diffusion * segment.start)).sum())

    @property
    def pins_on_the_way(self) -> bool:
        """Whether V comes to a kink that holds it, or leaves it: its rate of change jumps there, within a step."""
        return len({_pinned(instant) for instant in self.instants}) > 1


def _pinned(instant: Instant) -> tuple[int, ...]:
    """Return the inner nodes of the right angle at which V is an obstacle."""
    contact = instant.moment.contact
    nodes = np.flatnonzero(contact.right_angle)
    if nodes.size == 0:
        return ()
    at_lower, at_upper = contact.touching(instant.values.value[1:-1], nodes)
    return tuple(nodes[at_lower | at_upper].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class March:
    """The values on one grid from now to the horizon.

    Parameters
    ----------
    problem : ObstacleProblem
    grid : Grid
    parts : tuple of SegmentMarch
        The last segment first.
    """

    problem: ObstacleProblem
    grid: Grid
    parts: tuple[SegmentMarch, ...]

    @property
    def instants(self) -> list[Instant]:
        """The ends of all steps, now the last one."""
        return [instant for part in self.parts for instant in part.instants]

    @property
    def steps(self) -> tuple[int, ...]:
        """The number of steps in each segment, the last segment first."""
        return tuple(len(part.steps) for part in self.parts)

    def profile(self, instant: Instant) -> Profile:
        """Return the value between the nodes."""
        return profile_at(self.problem, self.grid, instant)

    @property
    def now(self) -> Profile:
        """The value at time 0."""
        return self.parts[-1].first


def profile_at(problem: ObstacleProblem, grid: Grid, instant: Instant) -> Profile:
    """Return the value between the nodes at an instant."""
    found = instant.values
    contacts = contact_sets(instant.moment, found.value, found.mass)
    return Profile(problem, grid, instant.t, found.value, contacts)


def march(
    problem: ObstacleProblem,
    grid: Grid,
    interrupt: Callable[[], bool] | None = None,
    complementarity: Complementarity = "averaged",
    *,
    checked: bool = True,
    steps_of: March | None = None,
) -> March | None:
    """March a problem from its horizon to now; None where `interrupt`, asked before every step, says so.

    With the `complementarity` "right-angle" every node has the plain condition of (11.65). A payoff outside its
    obstacles is refused where `checked`. With `steps_of`, the march of a problem with the same segments, it takes
    the same steps.
    """
    parts: list[SegmentMarch] = []
    after = payoff_of(problem, grid)
    for k, (start, end) in enumerate(problem.segments):
        segment = Segment(problem, grid, start, end, complementarity)
        known = before(problem, grid, end, after, checked=checked)
        mesh = time_mesh(segment) if steps_of is None else steps_of.parts[k].mesh
        part = _march_segment(segment, known, mesh, interrupt)
        if part is None:
            return None
        parts.append(part)
        profile = part.first
        after = Known(profile, _ends_of_contact(profile), profile.nodal)
    return March(problem, grid, tuple(parts))


def _march_segment(
    segment: Segment, known: Known, mesh: Mesh, interrupt: Callable[[], bool] | None
) -> SegmentMarch | None:
    end = just_before(segment.end)
    moment = segment.at(end)
    start = Start.of(segment.problem, moment, segment.grid, known, end)
    value, seen = start.values(known, segment.grid)
    values = Values(value, moment.contact.lower_mass - moment.contact.upper_mass)
    instants, taken = [Instant(end, moment, values)], []
    rate: Vector | None = None
    system: StageSystem | None = None
    for early, late, goes_on in mesh:
        if interrupt is not None and interrupt():
            return None
        stages: list[StageTaken] = []

        def stage(
            tau: float,
            base: Vector,
            a: float,
            near: Values,
            early: float = early,
            late: float = late,
            stages: list[StageTaken] = stages,
        ) -> Values:
            nonlocal system
            t = max(
                late - tau, early
            )  # where coefficients jump at `early`, rounding must not carry it across
            moment = segment.at(t)
            if system is None or system.moment is not moment or system.a != a:
                system = StageSystem.of(moment, a)
            found = solve_stage(system, base, near)
            stages.append(StageTaken(t, a, base, found))
            return found

        tableau = ESDIRK3 if goes_on and rate is not None else SDIRK3
        values, rate = take_step(tableau, stage, 0.0, values, late - early, rate, seen)
        taken.append(StepTaken(tableau, late - early, tuple(stages)))
        assert system is not None
        instants.append(Instant(early, system.moment, values))  # the last stage's moment
        seen = values.value
    first = profile_at(segment.problem, segment.grid, instants[-1])
    return SegmentMarch(segment, known, start, tuple(taken), tuple(instants), first)


def time_mesh(segment: Segment) -> Mesh:
    """Return (early, late) of each step, and whether it goes on smoothly from the one before.

    Steps end where the clock since the segment's end is (n/M)^2 of the whole. M is such that the first step, the
    shortest, is longer than the stage matrix needs in order to be an M-matrix (`_diffusion`), but in segments that are
    too short for two steps. A time at which coefficients jump or have a kink takes the place of an end, see `_roots`.
    """
    breaks = [time for time in segment.problem.diffusion.breaks if segment.start < time < segment.end]
    times, diffused, first = _clock(segment, breaks)
    middle = float(segment.grid.place(np.array([0.5 * (segment.grid.x.size - 1)]))[0])
    turns = 0 if segment.is_constant else _turns(segment.problem, segment.start, segment.end, middle)
    # Where the diffusion nearly vanishes in some places the number grows all the same, as others let it.
    fewest = 2 * segment.grid.refined
    largest = float(_slow(segment, 0.5 * (segment.start + segment.end)).max()) * segment.duration
    steps = max(_count(STEPS * math.sqrt(2.0 * first)), min(fewest, _count(STEPS * math.sqrt(2.0 * largest))))
    # It doubles from grid to grid where coefficients rise and fall, so that the grids' difference shows it.
    turned = fewest * max(turns, _growth(segment))
    passed = np.interp(-np.array(breaks[::-1]), -times, diffused) / diffused[-1]
    if breaks:
        roots = _roots(max(steps, turned), segment.grid.refined, np.sqrt(passed).tolist())
    else:
        roots = _squares(steps, fewest, turned)
    ends = np.interp(diffused[-1] * roots**2, diffused, times)
    for root, time in zip(np.sqrt(passed), breaks[::-1], strict=True):
        ends[np.argmin(np.abs(roots - root))] = time
    ends[0], ends[-1] = segment.end, segment.start
    return [(early, late, late not in breaks) for late, early in pairwise(ends.tolist())]


def _squares(steps: int, fewest: int, turned: int) -> Vector:
    """Return the roots of the clock at the ends of the steps, 0 to 1: their squares, cut where more are wanted.

    Steps behind the first are cut into parts that are not shorter than it is: first steps that the grid does not
    resolve cost two digits. It is cut where coefficients would turn within it.
    """
    ends = [0.0]
    parts = -(-max(fewest, turned) // steps)
    for n in range(1, steps + 1):
        own = max(1, min(parts, 2 * n - 1), turned // steps**2)
        ends += [(n - 1) ** 2 + (2 * n - 1) * k / own for k in range(1, own + 1)]
    roots: Vector = np.sqrt(np.array(ends)) / steps
    return roots


def _roots(steps: int, refined: int, breaks: list[float]) -> Vector:
    """Return the roots of the clock at the ends of about so many steps, 0 to 1, those of breaks among them.

    A break takes the place of the nearest end of the coarsest grid's steps, or is added to them; these are cut into
    equal parts whose number doubles from grid to grid. So the differences of grids fall as the order says, whatever
    lies between the breaks, and tell the error.
    """
    parts = 1
    while parts < refined and steps % (2 * parts) == 0:
        parts *= 2
    coarse = steps // parts
    ends = [k / coarse for k in range(coarse + 1)]
    for root in breaks:
        nearest = min(range(len(ends)), key=lambda k: abs(ends[k] - root))
        if 0 < nearest < len(ends) - 1 and ends[nearest] not in breaks:
            ends[nearest] = root
        else:
            ends = sorted({*ends, root})
    found = [np.zeros(1)]
    for left, right in pairwise(ends):
        own = 2 ** math.floor(math.log2(max(parts * (right - left) * coarse / SHORTEST, 1.0)))
        found.append(np.linspace(left, right, own + 1)[1:])
    return np.concatenate(found)


def _count(wanted: float) -> int:
    """Return the number of steps near to what is wanted, at least 2: from 4 on, 4 to 7 times a power of two.

    It doubles exactly where the cells are halved, so that the differences of grids fall as the third order says.
    """
    if not wanted < MOST_STEPS:
        raise NumericalError(
            "the steps would be too many: the diffusion is too small for the cells, or too large"
        )
    power: int = 2 ** math.floor(math.log2(max(wanted, 4.0) / 4.0))
    return max(2, math.floor(ROUNDED * wanted / power) * power)


def _clock(segment: Segment, breaks: list[float]) -> tuple[Vector, Vector, float]:
    """Return times from the segment's end to its start, and a clock since then, (k + 1,) each.

    The clock goes with the diffusion and, a share of it, with the time: where the diffusion is small for a while, no
    step may pass all of that. The last number is the diffusion of the whole segment, in cells^2, as the first step
    shows it.
    """
    if segment.problem.diffusion.is_constant:
        times = np.array([segment.end, segment.start])
    else:
        edges = [segment.end, *breaks[::-1], segment.start]
        pieces = max(FEWEST_PIECES, PIECES // (len(edges) - 1))
        cuts = [np.linspace(late, early, pieces + 1)[:-1] for late, early in pairwise(edges)]
        times = np.append(np.concatenate(cuts), segment.start)
    middles = (times[1:] + times[:-1]) / 2.0
    contact = segment.at(float(middles[middles.size // 2])).contact
    may_touch = (contact.lower_mass > 0.0) | (contact.upper_mass > 0.0)
    rates = np.array([_diffusion(segment, t, may_touch) for t in middles.tolist()])
    years = -np.diff(times)
    mean = (rates * years).sum() / segment.duration
    mixed = (1.0 - CLOCK_SHARE) * rates + CLOCK_SHARE * mean
    clock = np.concatenate([[0.0], np.cumsum(mixed * years)])
    return times, clock, float(clock[-1] * rates[0] / mixed[0])


@lru_cache(maxsize=64)
def _turns(problem: ObstacleProblem, start: float, end: float, x: float) -> int:
    """Return how often the coefficients and the source rise and fall between two times, at a place, but at breaks."""
    place, turns = np.array([x]), 0
    times = np.linspace(start, just_before(end), PIECES_OF_TURNS + 1).tolist()
    jumps = np.diff(np.searchsorted(problem.diffusion.breaks, times, side="right")) > 0
    for function in (*problem.diffusion.functions, problem.source_function):
        if function.has_t:
            values = np.array([float(function(place, t)[0]) for t in times])
            change = np.where(jumps, 0.0, np.diff(values))
            rises = change[np.abs(change) > ROUNDING * np.abs(values).max()] > 0.0
            turns += int(np.count_nonzero(rises[1:] != rises[:-1]))
    return turns


def _growth(segment: Segment) -> int:
    """Return by how many powers of e values may grow in a segment: the stage matrix needs 1 + a r > 0."""
    rate = segment.problem.diffusion.functions[2](segment.grid.x, 0.5 * (segment.start + segment.end))
    return int(max(-float(rate.min()), 0.0) * segment.duration)


def _diffusion(segment: Segment, t: float, may_touch: BoolVector) -> float:
    """Return D/b, in cells^2 a year, where it is least among the inner nodes that an obstacle may touch."""
    slow = _slow(segment, t)
    return float(slow[may_touch].min() if may_touch.any() else np.median(slow))


def _slow(segment: Segment, t: float) -> Vector:
    """Return D/b at the inner nodes, in cells^2 a year.

    The stage matrix is an M-matrix if a D >= (1 + a r) b/12 with b = (1 + |p|/2)/(1 + |p|/2 + p^2/12) and p the cell
    Peclet number.
    """
    D, drift = segment.transport(t)
    peclet = np.abs(drift / D)[1:-1]
    b = (1.0 + peclet / 2.0) / (1.0 + peclet / 2.0 + peclet * peclet / 12.0)
    slow: Vector = D[1:-1] / b
    return slow


def _ends_of_contact(profile: Profile) -> Vector:
    """Return where contact sets end, and V_xx jumps, as places."""
    edges = [
        edge for intervals in profile.contacts for pair in intervals for edge in pair if math.isfinite(edge)
    ]
    return profile.grid.place(np.array(edges)) if edges else np.zeros(0)
