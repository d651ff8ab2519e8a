"""The march from the horizon to now: segments between events, steps that grow as squares, stages."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.moment import Moment, Segment
from pricing_core.obstacle.problem import ObstacleProblem, just_before
from pricing_core.obstacle.profile import Profile, contact_sets
from pricing_core.obstacle.settings import STEPS
from pricing_core.obstacle.stage import Values, solve_stage
from pricing_core.obstacle.transfer import Known, before, payoff_of, start_values
from pricing_core.stepping import ESDIRK3, SDIRK3
from pricing_core.stepping.implicit import take_step


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
class March:
    """The values on one grid from now to the horizon.

    Parameters
    ----------
    problem : ObstacleProblem
    grid : Grid
    instants : tuple of Instant
        The last one is now.
    steps : tuple of int
        In each segment, the last segment first.
    """

    problem: ObstacleProblem
    grid: Grid
    instants: tuple[Instant, ...]
    steps: tuple[int, ...]

    def profile(self, instant: Instant) -> Profile:
        """Return the value between the nodes."""
        found = instant.values
        return Profile(
            self.problem,
            self.grid,
            instant.t,
            found.value,
            contact_sets(instant.moment, found.value, found.mass),
        )

    @property
    def now(self) -> Profile:
        """The value at time 0."""
        return self.profile(self.instants[-1])


def march(problem: ObstacleProblem, grid: Grid, interrupt: Callable[[], bool] | None = None) -> March | None:
    """March a problem from its horizon to now; None where `interrupt`, asked before every step, says so."""
    instants: list[Instant] = []
    counts = []
    after: Known = payoff_of(problem)
    for start, end in problem.segments:
        segment = Segment(problem, grid, start, end)
        known = before(problem, grid, end, after)
        moment = segment.at(just_before(end))
        value, seen = start_values(problem, moment, grid, known, just_before(end))
        contact = moment.contact
        values = Values(value, contact.lower_mass - contact.upper_mass)
        instants.append(Instant(just_before(end), moment, values))
        steps = step_count(segment, moment)
        counts.append(steps)
        rate: Vector | None = None
        for early, late, goes_on in time_mesh(segment, steps):
            if interrupt is not None and interrupt():
                return None
            tableau = ESDIRK3 if goes_on and rate is not None else SDIRK3

            def stage(tau: float, base: Vector, a: float, near: Values, late: float = late) -> Values:
                return solve_stage(segment.at(max(late - tau, segment.start)), base, a, near)  # noqa: B023

            values, rate = take_step(tableau, stage, 0.0, values, late - early, rate, seen)
            instants.append(Instant(early, segment.at(early), values))
            seen = values.value
        profile = Profile(
            problem, grid, start, values.value, contact_sets(instants[-1].moment, values.value, values.mass)
        )
        after = Known(profile, _ends_of_contact(profile))
    return March(problem, grid, tuple(instants), tuple(counts))


def step_count(segment: Segment, moment: Moment) -> int:
    """Return the number of steps of a segment, even and at least 2."""
    contact = moment.contact
    may_touch = (contact.lower_mass > 0.0) | (contact.upper_mass > 0.0)
    slow = contact.diffusion[may_touch] if may_touch.any() else np.median(contact.diffusion)
    deviation = math.sqrt(2.0 * float(np.min(slow)) * segment.duration)  # in cells
    return max(2, 2 * math.ceil(STEPS * deviation / 2.0 - 1e-9))


def time_mesh(segment: Segment, steps: int) -> list[tuple[float, float, bool]]:
    """Return (early, late) of each step, and whether it goes on smoothly from the one before."""
    ends = segment.end - segment.duration * (np.arange(steps + 1) / steps) ** 2
    ends[-1] = segment.start
    breaks = [time for time in segment.problem.diffusion.breaks if segment.start < time < segment.end]
    times = np.unique([*ends, *breaks])[::-1].tolist()
    return [(early, late, late not in breaks) for late, early in pairwise(times)]


def _ends_of_contact(profile: Profile) -> Vector:
    """Return where contact sets end, and V_xx jumps, as places."""
    edges = [
        edge for intervals in profile.contacts for pair in intervals for edge in pair if math.isfinite(edge)
    ]
    return profile.grid.place(np.array(edges)) if edges else np.zeros(0)
