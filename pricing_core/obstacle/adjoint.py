"""The march transposed: the derivative of a value in every direction, in one walk back.

The walk carries the weights of a sum over the values from now to the horizon. At each equation of the march it leaves
what a change of that equation is worth; a direction is then the sum of these over the changes that it makes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.obstacle.direction import Neighbours
from pricing_core.obstacle.linearised import StageEquation, before_each, start_values
from pricing_core.obstacle.march import March, SegmentMarch, StageTaken
from pricing_core.obstacle.moment import Segment
from pricing_core.obstacle.profile import Profile


@dataclass(frozen=True, slots=True, eq=False)
class StageWeights:
    """What a change of a stage's residual and of its values at fixed s is worth, shapes (n - 2,) and (n,)."""

    equation: StageEquation
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
        for part, after in reversed(before_each(march.parts)):
            stages: list[StageWeights] = []
            weights = _through_steps(part, weights, stages)
            parts.append(PartWeights(part, after, weights, tuple(stages)))
            at_nodes, at_points = part.start.transposed(weights)
            weights = at_nodes @ part.known.nodal(march.grid.x)
            if at_points.size:
                weights = weights + at_points.ravel() @ part.known.nodal(part.start.points.ravel())
        return cls(march.now, x, tuple(parts))

    def derivative(self, direction: Neighbours) -> float:
        """Return the derivative of the value in a direction."""
        problems = direction.both
        high, low = (replace(self.now, problem=problem)(np.array([self.x])) for problem in problems)
        total = float(high[0] - low[0])
        moves = not direction.is_of_events
        for entry in self.parts:
            own = entry.part.segment
            if not moves and direction.happens_alike(own.end):
                continue
            segments = [Segment(problem, own.grid, own.start, own.end) for problem in problems]
            high, low = (start_values(entry.part, entry.after, segment) for segment in segments)
            total += float(entry.of_start @ (high - low))
            for stage in entry.stages if moves else ():
                (residual, value), (low_residual, low_value) = (
                    stage.equation.at_fixed_parameter(segment) for segment in segments
                )
                total += float(stage.of_residual @ (residual - low_residual))
                total += float(stage.of_value @ (value - low_value))
        return total / (2.0 * direction.size)


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
    equation = StageEquation.of(part.segment, stage)
    moment, slope = equation.system.moment, equation.point.slope
    inner = of_value[1:-1].copy()
    if not equation.touches[0]:
        inner[0] += moment.left.first * of_value[0]
        inner[1] += moment.left.second * of_value[0]
    if not equation.touches[1]:
        inner[-1] += moment.right.first * of_value[-1]
        inner[-2] += moment.right.second * of_value[-1]
    nu = equation.system.solve_transposed(equation.point, slope * inner)
    found.append(StageWeights(equation, -nu, of_value))
    of_base = np.zeros_like(of_value)
    weights = moment.scheme.weights[:, 1:-1] * nu / stage.a
    of_base[:-2] += weights[0]
    of_base[1:-1] += weights[1]
    of_base[2:] += weights[2]
    return of_base
