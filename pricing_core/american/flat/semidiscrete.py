"""The method of lines: the American option as a complementarity system of ordinary differential equations.

v' = L v + e(tau) + u,  0 <= u _|_ v - g(tau) >= 0, in time to expiry tau, at the interior nodes of a grid in
x = ln(S/K). The multiplier u is K times smaller than the income lost by holding what should be exercised.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.closed_form import european_values
from pricing_core.american.flat.grid import Domain, Grid
from pricing_core.american.flat.obstacle import payoff_obstacle
from pricing_core.american.flat.operators import BlackScholesOperator, black_scholes_operator
from pricing_core.arrays import Matrix, Vector

if TYPE_CHECKING:
    from pricing_core.lcs import LCS


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
    """What holds at one instant, at all nodes: the obstacle, and the values prescribed at the two ends.

    Row 0 is the quantity itself; rows 1-3, where present, its derivatives by volatility, rate and yield.
    """

    obstacle: Matrix  # (m, N + 2), m = 1 or 4
    ends: Matrix  # (m, 2)


class ComplementarityForm(Protocol):
    """What an implicit stage reads of v' = L v + e(t) + u, 0 <= u _|_ v - g(t) >= 0."""

    @property
    def domain(self) -> Domain:
        """The ends of the grid, and whether they lie in the exercise region."""
        ...

    @property
    def operators(self) -> BlackScholesOperator:
        """L and its derivatives by volatility, rate and yield."""
        ...

    @property
    def payoff(self) -> Vector:
        """Positive at the nodes where exercise may bring something, shape (N + 2,)."""
        ...

    @property
    def scale(self) -> Vector | float:
        """The size of v, of which a residual is a part, at the unknowns, shape (N,), or everywhere."""
        ...

    def constraint(self, tau: float, rows: int) -> Constraint:
        """Return obstacle and end values at tau > 0."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class SemidiscreteForm(ABC):
    """The data of the differential complementarity system: contract, market, grid, L and the payoff on the grid."""

    option: Option
    market: FlatMarket
    domain: Domain
    grid: Grid
    operators: BlackScholesOperator
    payoff: Vector  # (N + 2,)

    @classmethod
    def discretise(cls, option: Option, market: FlatMarket, domain: Domain, grid: Grid) -> Self:
        """Discretise the option in space."""
        payoff = payoff_obstacle(option, grid.nodes)
        return cls(option, market, domain, grid, black_scholes_operator(grid, market), payoff)

    @property
    def scale(self) -> float:
        """1: residuals are fractions of the strike."""
        return 1.0

    @abstractmethod
    def start(self, rows: int) -> Matrix:
        """Return the state at expiry, shape (rows, N)."""

    @abstractmethod
    def constraint(self, tau: float, rows: int) -> Constraint:
        """Return obstacle and end values at tau > 0."""


@dataclass(frozen=True, slots=True, eq=False)
class ValueForm(SemidiscreteForm):
    """The option's value itself: the system (11.63)-(11.64), with g the payoff.

    The boundary conditions (11.55)-(11.56) give the end rows: v = g where the end lies in the exercise
    region, v = 0 out of the money, and the discounted forward where a deep option is not exercised.
    """

    def start(self, rows: int) -> Matrix:
        """Return the payoff (11.64), shape (1, N)."""
        _require_single_row(rows)
        return self.payoff[None, 1:-1]

    def constraint(self, tau: float, rows: int) -> Constraint:
        """Return the payoff and the end values at tau."""
        _require_single_row(rows)
        growth = np.array([math.exp(-self.market.rate * tau), math.exp(-self.market.dividend_yield * tau)])
        return Constraint(self.payoff[None, :], (self._end_terms() @ np.array([1.0, *growth]))[None, :])

    def as_lcs(self) -> "tuple[LCS, Vector]":
        """Return the linear complementarity system (11.63) and its initial state (11.64).

        The state is (v_1, ..., v_N, 1, e^{-r tau}, e^{-q tau}): the chapter's constant 1, and two
        exponentials that feed an end row where a deep option is not exercised; they are left out where
        nothing reads them. y = v - g, u the multiplier.

        Returns
        -------
        LCS
            A (n, n), B (n, N), C (N, n), D = 0.
        Vector, shape (n,)
            The initial state.
        """
        from pricing_core.lcs import LCS  # noqa: PLC0415  # a price needs nothing of it

        unknowns = self.grid.interior.size
        terms = self._end_terms()
        extra = 3 if np.any(terms[:, 1:]) else 1
        operator = self.operators.operator
        A = np.zeros((unknowns + extra, unknowns + extra))
        A[:unknowns, :unknowns] = operator.matrix.dense()
        A[0, unknowns:] += operator.lower[0] * terms[0, :extra]
        A[unknowns - 1, unknowns:] += operator.upper[-1] * terms[1, :extra]
        A[range(unknowns, unknowns + extra), range(unknowns, unknowns + extra)] = np.array(
            [0.0, -self.market.rate, -self.market.dividend_yield]
        )[:extra]
        B = np.eye(unknowns + extra, unknowns)
        C = np.eye(unknowns, unknowns + extra)
        C[:, unknowns] = -self.payoff[1:-1]
        return LCS(A, B, C), np.concatenate([self.payoff[1:-1], np.ones(extra)])

    def _end_terms(self) -> Matrix:
        """Coefficients of (1, e^{-r tau}, e^{-q tau}) in the left and the right end value, shape (2, 3)."""
        terms = np.zeros((2, 3))
        contact = (self.domain.contact_at_left, self.domain.contact_at_right)
        for row, node in enumerate((0, -1)):
            if contact[row]:
                terms[row, 0] = self.payoff[node]
            elif self.payoff[node] > 0.0:
                sign = 1.0 if self.option.is_put else -1.0
                terms[row, 1:] = sign, -sign * math.exp(self.grid.nodes[node])
        return terms


@dataclass(frozen=True, slots=True, eq=False)
class PremiumForm(SemidiscreteForm):
    """The early exercise premium p = v - v_European: the same equation, start 0, obstacle g - v_European.

    Subtracting the closed formula removes the kink at the strike. At the ends p is its obstacle in the
    exercise region, else 0.
    """

    def start(self, rows: int) -> Matrix:
        """Return zeros, shape (rows, N)."""
        return np.zeros((rows, self.grid.interior.size))

    def constraint(self, tau: float, rows: int) -> Constraint:
        """Return g - v_European and the end values at tau."""
        european = european_values(self.option.option_type, self.grid.nodes, tau, self.market)
        obstacle = -np.stack(
            [european.value, european.by_volatility, european.by_rate, european.by_yield][:rows]
        )
        obstacle[0] += self.payoff
        ends = obstacle[:, [0, -1]] * [self.domain.contact_at_left, self.domain.contact_at_right]
        return Constraint(obstacle, ends)


def _require_single_row(rows: int) -> None:
    if rows != 1:
        raise ValueError(
            "the value form carries no tangents: use the premium form for vega, rho and dividend rho"
        )
