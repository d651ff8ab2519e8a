"""The Black-Scholes operator (11.59) in s = S/K on a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.arrays import Vector
from pricing_core.linalg import Tridiagonal


@dataclass(frozen=True, slots=True, eq=False)
class ThreePointOperator:
    """Rows lower[i] v_{i-1} + diagonal[i] v_i + upper[i] v_{i+1}, i = 1, ..., N.

    Row 1 reads the boundary value v_0, row N reads v_{N+1}.
    """

    lower: Vector  # (N,)
    diagonal: Vector  # (N,)
    upper: Vector  # (N,)

    @property
    def matrix(self) -> Tridiagonal:
        """The part that acts on the unknowns, (N, N)."""
        return Tridiagonal(self.lower[1:], self.diagonal, self.upper[:-1])

    def times(self, v: Vector) -> Vector:
        """Return the matrix times v, both of shape (N,): zero at the ends."""
        result: Vector = self.diagonal * v
        result[1:] += self.lower[1:] * v[:-1]
        result[:-1] += self.upper[:-1] * v[1:]
        return result

    def apply(self, v: Vector) -> Vector:
        """Return the operator's value at the interior nodes, v given at all N + 2 nodes."""
        result: Vector = self.lower * v[:-2] + self.diagonal * v[1:-1] + self.upper * v[2:]
        return result

    def scaled(self, rows: Vector) -> ThreePointOperator:
        """Return the operator with row i multiplied by rows[i]."""
        return ThreePointOperator(rows * self.lower, rows * self.diagonal, rows * self.upper)

    def combine(self, weight: float, other: ThreePointOperator, other_weight: float) -> ThreePointOperator:
        """Return weight * self + other_weight * other."""
        return ThreePointOperator(
            weight * self.lower + other_weight * other.lower,
            weight * self.diagonal + other_weight * other.diagonal,
            weight * self.upper + other_weight * other.upper,
        )


def difference_operators(grid: Grid) -> tuple[ThreePointOperator, ThreePointOperator, ThreePointOperator]:
    """Return the central first and second differences on any grid, and the identity."""
    left, right = np.diff(grid.nodes)[:-1], np.diff(grid.nodes)[1:]
    first = ThreePointOperator(
        -right / (left * (left + right)), (right - left) / (left * right), left / (right * (left + right))
    )
    second = ThreePointOperator(
        2.0 / (left * (left + right)), -2.0 / (left * right), 2.0 / (right * (left + right))
    )
    identity = ThreePointOperator(np.zeros(left.size), np.ones(left.size), np.zeros(left.size))
    return first, second, identity


def spot_operator(
    grid: Grid, segment: Segment, watched: tuple[float, ...], excess: Vector | float = 0.0
) -> tuple[ThreePointOperator, bool]:
    """Discretise L = sigma**2 s**2/2 d2/ds2 + (r - q) s d/ds - r by central differences.

    Where a cell is too coarse for the drift m = (r - q) s, |m| ds > sigma**2 s**2, central differences would give
    negative off-diagonals and oscillations. The diffusion coefficient a = sigma**2 s**2/2 is then replaced by
    (m ds/2) coth(m ds/(2 a)) (Il'in 1969): an M-matrix at every cell size, but first order in ds.

    Parameters
    ----------
    excess : Vector, shape (N,), or 0
        What the volatility at the interior nodes exceeds the segment's by.

    Returns
    -------
    ThreePointOperator, bool
        L, and whether the diffusion was raised near one of the watched s.
    """
    s = grid.interior
    first, second, identity = difference_operators(grid)
    drift = (segment.rate - segment.dividend_yield) * s
    operator = second.scaled(raised_diffusion(grid, segment, excess)).combine(1.0, first.scaled(drift), 1.0)
    coarse = _half_drift(grid, segment) > _diffusion(grid, segment, excess)
    fitted = any(bool(coarse[int(np.argmin(np.abs(s - place)))]) for place in watched)
    return operator.combine(1.0, identity, -segment.rate), fitted


def raised_diffusion(grid: Grid, segment: Segment, excess: Vector | float = 0.0) -> Vector:
    """Return sigma**2 s**2/2, raised where a cell is too coarse for the drift, at the interior nodes, shape (N,)."""
    diffusion, half = _diffusion(grid, segment, excess), _half_drift(grid, segment)
    coarse = half > diffusion
    if not coarse.any():
        return diffusion
    fitting = np.tanh(np.divide(half, diffusion, out=np.full(half.size, math.inf), where=diffusion > 0.0))
    return np.where(coarse, (1.0 + 1e-12) * half / np.where(coarse, fitting, 1.0), diffusion)


def _diffusion(grid: Grid, segment: Segment, excess: Vector | float) -> Vector:
    volatility = np.maximum(segment.volatility + excess, 0.0)
    diffusion: Vector = 0.5 * volatility**2 * grid.interior**2
    return diffusion


def _half_drift(grid: Grid, segment: Segment) -> Vector:
    """Return |m| ds/2 with the wider one of a node's cells."""
    width = np.diff(grid.nodes)
    half: Vector = 0.5 * abs(segment.rate - segment.dividend_yield) * grid.interior
    return half * np.maximum(width[:-1], width[1:])
