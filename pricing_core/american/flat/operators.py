"""The Black-Scholes operator (11.59) on a grid, and its derivatives by volatility, rate and yield."""

from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.grid import Grid
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

    def scaled(self, rows: Vector) -> "ThreePointOperator":
        """Return the operator with row i multiplied by rows[i]."""
        return ThreePointOperator(rows * self.lower, rows * self.diagonal, rows * self.upper)

    def combine(
        self, weight: float, other: "ThreePointOperator", other_weight: float
    ) -> "ThreePointOperator":
        """Return weight * self + other_weight * other."""
        return ThreePointOperator(
            weight * self.lower + other_weight * other.lower,
            weight * self.diagonal + other_weight * other.diagonal,
            weight * self.upper + other_weight * other.upper,
        )


@dataclass(frozen=True, slots=True, eq=False)
class BlackScholesOperator:
    """L = sigma**2/2 A2 + (r - q - sigma**2/2) A1 - r I, (11.62) with a yield q, and its derivatives.

    `fitted` says whether exponential fitting replaced the diffusion coefficient (see
    `black_scholes_operator`).
    """

    operator: ThreePointOperator
    by_volatility: ThreePointOperator
    by_rate: ThreePointOperator
    by_yield: ThreePointOperator
    fitted: bool


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


def black_scholes_operator(grid: Grid, market: FlatMarket) -> BlackScholesOperator:
    """Discretise (11.59) by central differences; on a uniform grid interior rows as in (11.60)-(11.62).

    Where a cell is too coarse for the drift, |r - q - sigma**2/2| dx > sigma**2, central differences would
    give negative off-diagonals and oscillations. The diffusion coefficient a = sigma**2/2 is then replaced by
    (m dx/2) coth(m dx/(2 a)), m the drift (Il'in 1969): an M-matrix at every cell size, but first order in
    dx.
    """
    first, second, identity = difference_operators(grid)
    left, right = np.diff(grid.nodes)[:-1], np.diff(grid.nodes)[1:]
    diffusion = 0.5 * market.volatility**2
    drift = market.rate - market.dividend_yield - diffusion
    peclet = abs(drift) * np.maximum(left, right) / (2.0 * diffusion)
    coarse = peclet > 1.0
    at_strike = int(np.argmin(np.abs(grid.interior)))
    fitted = bool(coarse[at_strike])
    # 1e-12 keeps rounding from a negative entry
    factor = np.where(coarse, (1.0 + 1e-12) * peclet / np.tanh(np.where(coarse, peclet, 1.0)), 1.0)
    operator = (
        second.scaled(diffusion * factor).combine(1.0, first, drift).combine(1.0, identity, -market.rate)
    )
    return BlackScholesOperator(
        operator,
        by_volatility=second.combine(market.volatility, first, -market.volatility),
        by_rate=first.combine(1.0, identity, -1.0),
        by_yield=first.combine(-1.0, identity, 0.0),
        fitted=fitted,
    )
