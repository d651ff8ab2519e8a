"""The equations of a march, linearised at its own solution: what derivatives in any direction are made of.

The march is a chain of equations: at each stage R(s; base, p) = 0 for s, with V = V(s; p), and at each start of a
segment a linear function of the values after what happens there. How R, V and the starts depend on the parameters p is
told by central differences at fixed s and fixed values. What is held fixed are the grid, the number of steps and the
places where an event clips the value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.obstacle.averaged import Point, Side
from pricing_core.obstacle.march import SegmentMarch, StageTaken
from pricing_core.obstacle.moment import Segment
from pricing_core.obstacle.problem import just_before
from pricing_core.obstacle.profile import Profile
from pricing_core.obstacle.stage import StageSystem
from pricing_core.obstacle.transfer import Known, Start, before, payoff_of


@dataclass(frozen=True, slots=True, eq=False)
class StageEquation:
    """A stage at its solution.

    Parameters
    ----------
    stage : StageTaken
    system : StageSystem
    side : Side
    s : Vector, shape (n - 2,)
    point : Point
        The values and masses at s.
    touches : (bool, bool)
        Whether V is an obstacle at the left and at the right end, rather than told by its neighbours.
    """

    stage: StageTaken
    system: StageSystem
    side: Side
    s: Vector
    point: Point
    touches: tuple[bool, bool]

    @classmethod
    def of(cls, segment: Segment, stage: StageTaken) -> StageEquation:
        """Return the equation of a stage that has been taken in a segment."""
        moment = segment.at(stage.t)
        system = StageSystem.of(moment, stage.a)
        V = stage.values.value[1:-1]
        side = system.side or moment.contact.side(V, system.omega)
        s = side.parameter(V, stage.values.mass)
        point = side.at(s)
        left, right = (any(moment.contact.touching(point.value, node)) for node in (0, -1))
        return cls(stage, system, side, s, point, (bool(left), bool(right)))

    def at_fixed_parameter(self, segment: Segment) -> tuple[Vector, Vector]:
        """Return R (n - 2,) and V (n,) of a changed problem at the same s and the same base.

        Where s is 1 or more V is free of the obstacle and itself held fixed: in the scale b of s a difference of two
        problems is off by the square of their distance, in each stage anew however short it is.
        """
        stage, side, s = self.stage, self.side, self.s
        system = StageSystem.of(segment.at(stage.t), stage.a)
        contact = system.moment.contact
        down = side.c > 0.0
        c = np.where(down, contact.lower_mass, -contact.upper_mass)
        obstacle = np.where(down, contact.lower, contact.upper)
        nodes, moves = side.right_angle, side.averaged & (s < 1.0)
        moved = replace(
            side,
            obstacle=np.where(moves, obstacle, side.obstacle),
            bend=np.where(moves, c / contact.diffusion, side.bend),
            c=np.where(moves, c, side.c),
            low=contact.lower[nodes],
            high=contact.upper[nodes],
        )
        if nodes.size:  # pinned nodes go with their obstacles
            pinned_low, pinned_high = s[nodes] <= side.low, s[nodes] >= side.high
            s = s.copy()
            s[nodes[pinned_low]] += moved.low[pinned_low] - side.low[pinned_low]
            s[nodes[pinned_high]] += moved.high[pinned_high] - side.high[pinned_high]
        point = moved.at(s)
        return system.residual(point, system.rhs(stage.base)), system.moment.with_ends(point.value)


def start_values(part: SegmentMarch, after: Profile | None, segment: Segment) -> Vector:
    """Return what the first step of a segment starts from in a changed problem, with the same values after its end.

    Parameters
    ----------
    part : SegmentMarch
    after : Profile or None
        The values after the segment's end; None at the horizon.
    segment : Segment
        The same segment of the changed problem.
    """
    problem, grid, kinks = segment.problem, segment.grid, part.known.kinks
    known = payoff_of(problem, grid)
    if after is not None:
        moved = replace(after, problem=problem)
        known = Known(moved, kinks, moved.nodal)
    known = replace(before(problem, grid, segment.end, known, checked=False), kinks=kinks)
    end = just_before(segment.end)
    return Start.of(problem, segment.at(end), grid, known, end).values(known, grid)[1]


def before_each(parts: tuple[SegmentMarch, ...]) -> list[tuple[SegmentMarch, Profile | None]]:
    """Return each segment's march, the last segment first, with the values after its end."""
    return list(zip(parts, [None, *(part.first for part in parts[:-1])], strict=True))
