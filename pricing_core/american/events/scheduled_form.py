"""The method of lines on one segment of a schedule: V' = LV + e(t) + u in s = S/K, t years before the segment's end."""

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.events.scheduled_grid import spot_operator
from pricing_core.american.flat.grid import Domain, Grid
from pricing_core.american.flat.operators import BlackScholesOperator
from pricing_core.american.flat.semidiscrete import Constraint
from pricing_core.american.flat.tridiagonal_step import OptionState
from pricing_core.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class SegmentForm:
    """The value form of one segment: 0 <= u _|_ v - g(t) >= 0 with g = sign (1 - A e^{-rt} - s), where exercisable.

    g is not cut off at 0: v is positive of itself. At the two ends v is a straight line in s, a + b s, which the
    equation carries to a e^{-rt} + b s e^{-qt}, or exercised where that is more (exact for the end s = 0).

    Parameters
    ----------
    sign : float
        1 for a put, -1 for a call.
    escrow : float
        A at the segment's end, in units of the strike.
    lines : Matrix, shape (2, 2)
        (a, b) at the left and the right end of the grid, at the segment's end.
    """

    segment: Segment
    grid: Grid
    sign: float
    escrow: float
    lines: Matrix
    operators: BlackScholesOperator

    @classmethod
    def discretise(
        cls,
        segment: Segment,
        grid: Grid,
        sign: float,
        strike: float,
        values: Vector,
        watched: tuple[float, ...],
    ) -> "SegmentForm":
        """Discretise a segment at whose end the option has `values` at the nodes, shape (N + 2,)."""
        operators = spot_operator(grid, segment, watched)
        return cls(segment, grid, sign, segment.escrow / strike, _lines(grid.nodes, values), operators)

    @property
    def domain(self) -> Domain:
        """The grid's ends; exercised where the end is, half-way through the segment."""
        t = 0.5 * self.segment.duration
        ends, obstacle = self._held_ends(t), self.obstacle(t, self.grid.nodes[[0, -1]])
        contact = (obstacle >= ends) & self.segment.exercisable
        left, right = self.grid.nodes[[0, -1]].tolist()
        return Domain(left, right, bool(contact[0]), bool(contact[1]), 0.0)

    @property
    def payoff(self) -> Vector:
        """Ones: v meets the obstacle in the exercise region only."""
        return np.ones(self.grid.nodes.size)

    @property
    def scale(self) -> Vector:
        """max(1, s): the payoff grows like s."""
        return np.maximum(self.grid.interior, 1.0)

    def obstacle(self, t: float, s: Vector) -> Vector:
        """Return g(t)."""
        escrow = self.escrow * math.exp(-self.segment.rate * t) if self.escrow else 0.0
        result: Vector = self.sign * (1.0 - escrow - s)
        return result

    def curvature(self, node: int) -> float:
        """Return J, the second derivative of v - g on the free side of an exercise boundary at an interior node.

        sigma**2 s**2/2 J = sign (r - q s), what exercise earns and holding does not (in the escrowed model, too).
        """
        operator, nodes = self.operators.operator, self.grid.nodes[node : node + 3]
        left, right = nodes[1] - nodes[0], nodes[2] - nodes[1]
        twice_diffusion = float(operator.lower[node] * left**2 + operator.upper[node] * right**2)
        earned = self.sign * (self.segment.rate - self.segment.dividend_yield * float(nodes[1]))
        return 2.0 * earned / twice_diffusion if twice_diffusion > 0.0 else 0.0

    def constraint(self, tau: float, rows: int) -> Constraint:
        """Return obstacle and end values tau years before the segment's end; rows is 1."""
        obstacle = self.obstacle(tau, self.grid.nodes)
        ends = self._held_ends(tau)
        if self.segment.exercisable:
            ends = np.maximum(ends, obstacle[[0, -1]])
        return Constraint(obstacle[None, :], ends[None, :])

    def everywhere(self, state: OptionState, t: float) -> Vector:
        """Return the values at all nodes, shape (N + 2,)."""
        ends = self.constraint(t, 1).ends[0]
        return np.concatenate([ends[:1], state.value[0], ends[1:]])

    def start(self, values: Vector) -> OptionState:
        """Return the state at the segment's end."""
        slack = values[1:-1] - self.obstacle(0.0, self.grid.interior)
        contact = (slack <= 0.0) & self.segment.exercisable
        return OptionState(values[None, 1:-1], np.maximum(slack, 0.0), contact, np.zeros(slack.size), 0.0)

    def _held_ends(self, t: float) -> Vector:
        growth = math.exp(-self.segment.rate * t), math.exp(-self.segment.dividend_yield * t)
        result: Vector = (
            self.lines[:, 0] * growth[0] + self.lines[:, 1] * growth[1] * self.grid.nodes[[0, -1]]
        )
        return result


def _lines(nodes: Vector, values: Vector) -> Matrix:
    lines = np.zeros((2, 2))
    for row, (end, next_node) in enumerate(((0, 1), (-1, -2))):
        slope = (values[next_node] - values[end]) / (nodes[next_node] - nodes[end])
        lines[row] = values[end] - slope * nodes[end], slope
    return lines
