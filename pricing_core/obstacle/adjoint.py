"""The march transposed: the derivative of a value by coefficients, obstacles and events, in one walk back.

The march is a chain of equations: at each stage R(s; base, p) = 0 for s, with V = V(s; p), and at each start of a
segment a linear function of the values after what happens there. The walk carries the weights of a sum over the values
from now to the horizon. At each equation it leaves what multiplies a change of the parameters p; a direction is then
the sum of these over central differences of R, V and the starts at fixed s and fixed values. What is held fixed are the
grid, the number of steps and the places where an event clips the value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, UnknownNameError
from pricing_core.obstacle.averaged import Side
from pricing_core.obstacle.diffusion import Diffusion
from pricing_core.obstacle.event import Event
from pricing_core.obstacle.functions import Function, read_function
from pricing_core.obstacle.march import March, SegmentMarch, StageTaken
from pricing_core.obstacle.moment import Segment
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.problem import ObstacleProblem, just_before
from pricing_core.obstacle.profile import Profile
from pricing_core.obstacle.stage import StageSystem
from pricing_core.obstacle.transfer import Known, Start, before, payoff_of

DIFFERENCE = (
    1e-5  # of a direction, by which parameters are changed: its square is lost, and rounding divided by it
)
COEFFICIENTS = ("volatility", "drift", "rate")
OBSTACLES = ("payoff", "lower", "upper")
NAMES = (*COEFFICIENTS, "source", *OBSTACLES, "cash")


@dataclass(frozen=True, slots=True, eq=False)
class StageWeights:
    """What a change of a stage's residual and of its values at fixed s is worth, shapes (n - 2,) and (n,)."""

    stage: StageTaken
    side: Side
    s: Vector
    of_residual: Vector
    of_value: Vector


@dataclass(frozen=True, slots=True, eq=False)
class PartWeights:
    """What a change of the values that a segment starts from is worth, shape (n,), and of each of its stages.

    The values after the segment's end are `after`, None at the horizon.
    """

    part: SegmentMarch
    after: Profile | None
    of_start: Vector
    stages: tuple[StageWeights, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """The weights that one walk back leaves.

    Parameters
    ----------
    now : Profile
        The value now.
    x : float
        The place of the value.
    parts : tuple of PartWeights
        The first segment first.
    """

    now: Profile
    x: float
    parts: tuple[PartWeights, ...]

    @classmethod
    def of(cls, march: March, x: float) -> Walk:
        """Walk from the value at x, now, back to the horizon."""
        parts: list[PartWeights] = []
        weights = march.now.nodal(np.array([x]))[0]
        later = [None, *(part.first for part in march.parts[:-1])]
        for part, after in zip(march.parts[::-1], later[::-1], strict=True):
            stages: list[StageWeights] = []
            weights = _through_steps(part, weights, stages)
            parts.append(PartWeights(part, after, weights, tuple(stages)))
            at_nodes, at_points = part.start.transposed(weights)
            weights = at_nodes @ part.known.nodal(march.grid.x)
            if at_points.size:
                weights = weights + at_points.ravel() @ part.known.nodal(part.start.points.ravel())
        return cls(march.now, x, tuple(parts))

    def derivative(self, direction: Mapping[str, Any]) -> float:
        """Return the derivative of the value in a direction: numbers or functions by name."""
        problems = [changed(self.now.problem, direction, sign * DIFFERENCE) for sign in (1.0, -1.0)]
        high, low = (replace(self.now, problem=problem)(np.array([self.x])) for problem in problems)
        total = float(high[0] - low[0])
        for entry in self.parts:
            own = entry.part.segment
            segments = [Segment(problem, own.grid, own.start, own.end) for problem in problems]
            high, low = (_start_values(entry, segment) for segment in segments)
            total += float(entry.of_start @ (high - low))
            for stage in entry.stages:
                (residual, value), (low_residual, low_value) = (
                    _at_fixed_parameter(stage, segment) for segment in segments
                )
                total += float(stage.of_residual @ (residual - low_residual))
                total += float(stage.of_value @ (value - low_value))
        return total / (2.0 * DIFFERENCE)


def _through_steps(part: SegmentMarch, weights: Vector, found: list[StageWeights]) -> Vector:
    """Carry weights of the values at the segment's beginning to those that its first step starts from."""
    of_rate = np.zeros_like(weights)
    for step in part.steps[::-1]:
        tableau, h = step.tableau, step.h
        count = len(tableau.a)
        offset = count - len(step.stages)  # 1 where the first stage is explicit
        of_value = [np.zeros_like(weights) for _ in range(count)]
        of_base = [np.zeros_like(weights) for _ in range(count)]
        last = step.stages[-1]
        of_value[-1] = weights + of_rate / last.a
        of_base[-1] = -of_rate / last.a
        weights, of_rate = np.zeros_like(weights), np.zeros_like(weights)
        for i in range(count - 1, offset - 1, -1):
            of_base[i] = of_base[i] + _through_stage(part, step.stages[i - offset], of_value[i], found)
            weights = weights + of_base[i]
            for j in range(i):
                share = tableau.a[i][j]
                if j < offset:
                    of_rate = of_rate + h * share * of_base[i]
                else:
                    ratio = share / tableau.a[j][j]
                    of_value[j] = of_value[j] + ratio * of_base[i]
                    of_base[j] = of_base[j] - ratio * of_base[i]
    return weights


def _through_stage(
    part: SegmentMarch, stage: StageTaken, of_value: Vector, found: list[StageWeights]
) -> Vector:
    """Return the weights of the stage's base, shape (n,)."""
    moment = part.segment.at(stage.t)
    system = StageSystem.of(moment, stage.a)
    V = stage.values.value[1:-1]
    side = system.side or moment.contact.side(V, system.omega)
    s = side.parameter(V, stage.values.mass)
    point = side.at(s)
    inner = of_value[1:-1].copy()
    touches = [any(moment.contact.touching(point.value, node)) for node in (0, -1)]
    if not touches[0]:
        inner[0] += moment.left.first * of_value[0]
        inner[1] += moment.left.second * of_value[0]
    if not touches[1]:
        inner[-1] += moment.right.first * of_value[-1]
        inner[-2] += moment.right.second * of_value[-1]
    nu = system.solve_transposed(point, point.slope * inner)
    found.append(StageWeights(stage, side, s, -nu, of_value))
    of_base = np.zeros_like(of_value)
    weights = moment.scheme.weights[:, 1:-1] * nu / stage.a
    of_base[:-2] += weights[0]
    of_base[1:-1] += weights[1]
    of_base[2:] += weights[2]
    return of_base


def _at_fixed_parameter(entry: StageWeights, segment: Segment) -> tuple[Vector, Vector]:
    """Return the residual and the values at the nodes at the s and the base of a stage, of a changed problem."""
    stage, side, s = entry.stage, entry.side, entry.s
    system = StageSystem.of(segment.at(stage.t), stage.a)
    contact = system.moment.contact
    down = side.c > 0.0
    c = np.where(down, contact.lower_mass, -contact.upper_mass)
    obstacle = np.where(down, contact.lower, contact.upper)
    nodes = side.right_angle
    moved = replace(
        side,
        obstacle=np.where(side.averaged, obstacle, side.obstacle),
        kappa=np.where(side.averaged, c / (2.0 * contact.diffusion), side.kappa),
        c=np.where(side.averaged, c, 0.0),
        low=contact.lower[nodes],
        high=contact.upper[nodes],
    )
    if nodes.size:  # pinned nodes go with their obstacles
        pinned_low, pinned_high = s[nodes] <= side.low, s[nodes] >= side.high
        s = s.copy()
        s[nodes] += np.where(
            pinned_low, moved.low - side.low, np.where(pinned_high, moved.high - side.high, 0.0)
        )
    point = moved.at(s)
    return system.residual(point, system.rhs(stage.base)), system.moment.with_ends(point.value)


def _start_values(entry: PartWeights, segment: Segment) -> Vector:
    """Return what the first step of a segment starts from in a changed problem, with the same values after its end."""
    problem, grid, kinks = segment.problem, segment.grid, entry.part.known.kinks
    known = payoff_of(problem, grid)
    if entry.after is not None:
        after = replace(entry.after, problem=problem)
        known = Known(after, kinks, after.nodal)
    known = replace(before(problem, grid, segment.end, known, checked=False), kinks=kinks)
    end = just_before(segment.end)
    return Start.of(problem, segment.at(end), grid, known, end).values(known, grid)[1]


def changed(problem: ObstacleProblem, direction: Mapping[str, Any], size: float) -> ObstacleProblem:
    """Return a problem whose coefficients, obstacles and events are changed by `size` times a direction.

    Raises
    ------
    UnknownNameError, InvalidInputError
        A name is not known, or stands for something that the problem has not.
    """
    unknown = [name for name in direction if name not in NAMES]
    if unknown:
        raise UnknownNameError("direction", unknown, NAMES)
    changes: dict[str, Any] = {}
    diffusion = problem.diffusion
    functions = dict(zip(COEFFICIENTS, diffusion.functions, strict=True))
    if any(name in direction for name in COEFFICIENTS):
        summed = {
            name: _sum(functions[name], direction[name], size)
            if name in direction
            else getattr(diffusion, name)
            for name in COEFFICIENTS
        }
        changes["diffusion"] = Diffusion(**summed, breaks=diffusion.breaks)
    if "source" in direction:
        changes["source"] = _sum(problem.source_function, direction["source"], size)
    for name in OBSTACLES:
        if name in direction:
            obstacle: Obstacle | None = getattr(problem, name)
            if obstacle is None:
                raise InvalidInputError(
                    name, direction[name], f"left out: the problem has no {name} obstacle"
                )
            changes[name] = replace(obstacle, value=_sum(obstacle.function, direction[name], size))
    if "cash" in direction:
        changes["events"] = _with_cash(problem, direction["cash"], size)
    return replace(problem, **changes)


def _sum(function: Function, direction: Any, size: float) -> Any:
    """Return a function of x and t, or of x alone, that is changed by `size` times a direction."""
    other = read_function(function.name, direction)
    if function.has_t or other.has_t:
        return lambda x, t: function(x, t) + size * other(x, t)
    return lambda x: function(x, 0.0) + size * other(x, 0.0)


def _with_cash(problem: ObstacleProblem, amounts: Any, size: float) -> tuple[Event, ...]:
    given = np.broadcast_to(np.asarray(amounts, dtype=np.float64), (len(problem.events),)).tolist()
    events = []
    for event, amount in zip(problem.events, given, strict=True):
        _, cash = event.functions
        added = size * amount if cash is None else _sum(cash, amount, size)
        events.append(replace(event, cash=added))
    return tuple(events)
