"""Tangents of the march: how the value at every place goes with a direction, in one linear march forward.

Each stage's equation is solved once more, linearised, with the change of the stage's base and of the parameters on its
right-hand side. What comes has a slope and a curvature as V has: the mixed derivatives by a direction and by place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.obstacle.compact import product
from pricing_core.obstacle.direction import Neighbours
from pricing_core.obstacle.linearised import StageEquation, before_each, start_values
from pricing_core.obstacle.march import March, SegmentMarch
from pricing_core.obstacle.moment import Segment
from pricing_core.stepping.implicit import take_step


@dataclass(frozen=True, slots=True)
class Change:
    """The derivative of V at the nodes, shape (n,)."""

    value: Vector


def tangent(march: March, direction: Neighbours, x: Vector) -> Matrix:
    """Return the derivatives of V, V_x and V_xx at places x (m,) in a direction, shape (3, m)."""
    change = np.zeros(march.grid.x.size)
    for part, after in before_each(march.parts):
        own = part.segment
        high, low = (Segment(problem, own.grid, own.start, own.end) for problem in direction.both)
        start = direction.difference(start_values(part, after, high), start_values(part, after, low))
        if after is not None:
            start = start + _through_start(part, change)
        change = _through_steps(part, Change(start), direction, (high, low))
    ends = (
        replace(march.now, problem=problem, value=march.now.value + size * change)
        for problem, size in zip(direction.both, (direction.size, -direction.size), strict=True)
    )
    above, below = (profile.derivatives(x) for profile in ends)
    return np.asarray(direction.difference(above, below))


def _through_start(part: SegmentMarch, change: Vector) -> Vector:
    """Return the change of what a segment's first step starts from, given that after its end."""
    start, known = part.start, part.known
    at_nodes = known.nodal(part.segment.grid.x) @ change
    at_nodes[[*start.held]] = 0.0
    return start.seen(at_nodes, (known.nodal(start.points.ravel()) @ change).reshape(start.points.shape))


def _through_steps(
    part: SegmentMarch, change: Change, direction: Neighbours, segments: tuple[Segment, Segment]
) -> Vector:
    rate = None
    for step in part.steps:
        equations = (StageEquation.of(part.segment, stage) for stage in step.stages)

        def stage(
            t: float, base: Vector, a: float, near: Change, equations: Iterator[StageEquation] = equations
        ) -> Change:
            return Change(_through_stage(next(equations), base, direction, segments))

        change, rate = take_step(step.tableau, stage, 0.0, change, step.h, rate)
    return change.value


def _through_stage(
    equation: StageEquation, base: Vector, direction: Neighbours, segments: tuple[Segment, Segment]
) -> Vector:
    """Return the change of V at the nodes with those of the stage's base and of the parameters."""
    system, point = equation.system, equation.point
    (high, high_value), (low, low_value) = (equation.at_fixed_parameter(segment) for segment in segments)
    pushed = product(system.moment.scheme.weights, base / equation.stage.a) - direction.difference(high, low)
    change: Vector = direction.difference(high_value, low_value)
    inner = point.slope * system.solve(point, pushed)
    change[1:-1] += inner
    for end, rule, first, second in ((0, system.moment.left, 0, 1), (-1, system.moment.right, -1, -2)):
        if not equation.touches[end]:
            change[end] += rule.first * inner[first] + rule.second * inner[second]
    return change
