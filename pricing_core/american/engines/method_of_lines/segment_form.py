"""The complementarity system of one segment: V' = L V + u, 0 <= u _|_ V - g(t) >= 0 at the nodes of a grid in s = S/K.

Time t runs backward from the segment's end, in years. The multiplier u is K times smaller than the income lost by
holding what should be exercised.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.node_volatility import NodeVolatility
from pricing_core.american.engines.method_of_lines.operators import ThreePointOperator, spot_operator
from pricing_core.arrays import BoolVector, Matrix, Vector

if TYPE_CHECKING:
    from pricing_core.lcs import LCS


@dataclass(frozen=True, slots=True, eq=False)
class SegmentForm:
    """The semidiscrete option in one segment, in units of the strike: (11.63) with g = sign (1 - A e^{-rt} - s).

    g is not cut off at 0: V is positive of itself. At the two ends V is a straight line in s, a + b s, which the
    equation carries to a e^{-rt} + b s e^{-qt}, or exercised where that is more (exact for the end s = 0).

    Parameters
    ----------
    segment : Segment
    grid : Grid
    sign : float
        1 for a put, -1 for a call.
    escrow : float
        A at the segment's end.
    lines : Matrix, shape (2, 2)
        (a, b) at the left and the right end of the grid, at the segment's end.
    operator : ThreePointOperator
        L.
    fitted : bool
        Whether the drift dominates the diffusion near the spot or the strike (`spot_operator`).
    local : NodeVolatility or None
        Where the operator depends on time (`at`), what it is made of; `operator` is that of the segment's end.
    """

    segment: Segment
    grid: Grid
    sign: float
    escrow: float
    lines: Matrix
    operator: ThreePointOperator
    fitted: bool
    local: NodeVolatility | None = None

    @classmethod
    def discretise(
        cls,
        segment: Segment,
        grid: Grid,
        *,
        sign: float,
        strike: float,
        values: Vector,
        watched: tuple[float, ...],
        local: NodeVolatility | None = None,
    ) -> SegmentForm:
        """Discretise a segment at whose end the option has `values` at the nodes, shape (N + 2,)."""
        excess = 0.0 if local is None else local.at(segment.end)
        operator, fitted = spot_operator(grid, segment, watched, excess)
        lines = end_lines(grid.nodes, values)
        return cls(segment, grid, sign, segment.escrow / strike, lines, operator, fitted, local)

    def at(self, t: float) -> SegmentForm:
        """Return the system with the operator of a time, t years before the segment's end."""
        if self.local is None or self.local.times.size == 1:
            return self
        operator, _ = spot_operator(self.grid, self.segment, (), self.local.at(self.segment.end - t))
        return replace(self, operator=operator)

    @property
    def scale(self) -> Vector:
        """The size of V at the unknowns, of which a residual is a part: max(1, s), shape (N,)."""
        return np.maximum(self.grid.interior, 1.0)

    def obstacle(self, t: float, s: Vector) -> Vector:
        """Return g(t) at s."""
        escrow = self.escrow * math.exp(-self.segment.rate * t) if self.escrow else 0.0
        result: Vector = self.sign * (1.0 - escrow - s)
        return result

    def ends(self, t: float) -> Vector:
        """Return V at the two ends of the grid, shape (2,)."""
        held = self._held_ends(t)
        if not self.segment.exercisable:
            return held
        return np.maximum(held, self.obstacle(t, self.grid.nodes[[0, -1]]))

    def contact_at_ends(self) -> BoolVector:
        """Tell for both ends of the grid whether they lie in the exercise region, half-way through the segment."""
        t = 0.5 * self.segment.duration
        exercised = self.obstacle(t, self.grid.nodes[[0, -1]]) >= self._held_ends(t)
        return exercised & self.segment.exercisable

    def curvature(self, node: int) -> float:
        """Return J, the second derivative of V - g on the free side of an exercise boundary at an interior node.

        sigma**2 s**2/2 J = sign (r - q s), what exercise earns and holding does not (in the escrowed model, too).
        """
        nodes = self.grid.nodes[node : node + 3]
        left, right = nodes[1] - nodes[0], nodes[2] - nodes[1]
        lower, upper = self.operator.lower[node], self.operator.upper[node]
        twice_diffusion = float(lower * left**2 + upper * right**2)
        earned = self.sign * (self.segment.rate - self.segment.dividend_yield * float(nodes[1]))
        return 2.0 * earned / twice_diffusion if twice_diffusion > 0.0 else 0.0

    def everywhere(self, value: Vector, t: float) -> Vector:
        """Return the values at all nodes, shape (N + 2,), from those at the unknowns."""
        ends = self.ends(t)
        return np.concatenate([ends[:1], value, ends[1:]])

    def as_lcs(self, values: Vector) -> tuple[LCS, Vector]:
        """Return the linear complementarity system (11.63) of the segment and its initial state (11.64).

        The state is (V_1, ..., V_N, 1, e^{-rt}, e^{-qt}): the chapter's constant 1, and two exponentials that feed the
        straight lines at the ends and the escrow; y = V - g, u the multiplier.

        Parameters
        ----------
        values : Vector, shape (N + 2,)
            Values at the segment's end.

        Returns
        -------
        LCS
            A (N + 3, N + 3), B (N + 3, N), C (N, N + 3), D = 0.
        Vector, shape (N + 3,)
            The initial state.
        """
        from pricing_core.lcs import LCS  # noqa: PLC0415  # a price needs nothing of it

        N, nodes = self.grid.interior.size, self.grid.nodes
        segment, contact = self.segment, self.contact_at_ends()
        A = np.zeros((N + 3, N + 3))
        A[:N, :N] = self.operator.matrix.dense()
        for row, end, entry in ((0, 0, self.operator.lower[0]), (N - 1, -1, self.operator.upper[-1])):
            a, b = self.lines[end]
            exercised = (self.sign * (1.0 - nodes[end]), -self.sign * self.escrow, 0.0)
            A[row, N:] += entry * np.array(exercised if contact[end] else (0.0, a, b * nodes[end]))
        A[N + 1, N + 1], A[N + 2, N + 2] = -segment.rate, -segment.dividend_yield
        B, C = np.eye(N + 3, N), np.eye(N, N + 3)
        C[:, N], C[:, N + 1] = -self.sign * (1.0 - nodes[1:-1]), self.sign * self.escrow
        return LCS(A, B, C), np.concatenate([values[1:-1], np.ones(3)])

    def _held_ends(self, t: float) -> Vector:
        growth = math.exp(-self.segment.rate * t), math.exp(-self.segment.dividend_yield * t)
        result: Vector = (
            self.lines[:, 0] * growth[0] + self.lines[:, 1] * growth[1] * self.grid.nodes[[0, -1]]
        )
        return result


def end_lines(nodes: Vector, values: Vector) -> Matrix:
    """Return (a, b) of the straight lines a + b s through the two first and the two last values, shape (2, 2)."""
    lines = np.zeros((2, 2))
    for row, (end, next_node) in enumerate(((0, 1), (-1, -2))):
        slope = (values[next_node] - values[end]) / (nodes[next_node] - nodes[end])
        lines[row] = values[end] - slope * nodes[end], slope
    return lines
