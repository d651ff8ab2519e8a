"""American puts from the integral equation of their exercise boundary: a reference that knows no grid.

The premium is what exercise earns while the spot is below the boundary B (Kim 1990),

    p(S) = integral over u in (0, T) of r e^{-r s} N(-d2(s, S/B(u))) - q S e^{-q s} N(-d1(s, S/B(u))), s = T - u,

with strike 1, u the time to expiry at which it is earned, d1, d2 = (ln y + (r - q +- sigma**2/2) s) / (sigma
sqrt(s)). B solves the fixed-point system A of Andersen, Lake and Offengenden (2016). ln(B/B(0+))**2 is nearly
smooth in sqrt(tau): it is a polynomial here. u = T sin**2(phi) makes the integrands smooth at both ends.
A finer discretisation changes prices by less than 1e-10, deltas by 1e-9, gammas by 1e-7 and boundaries by 3e-7 on
the classic sets; the tests hold all of it against tabulated values.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray
from scipy.special import ndtr

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.american.engines.black_scholes import ONE_OVER_SQRT_TWO_PI
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.perpetual import perpetual_boundary
from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

DEGREE = 32  # Degree of the boundary's polynomial.
BOUNDARY_POINTS, VALUE_POINTS = 64, 500  # quadrature
CONVERGED = 1e-13  # largest change of ln B
MOST_ITERATIONS = 500


@dataclass(frozen=True, slots=True, eq=False)
class PutBoundary:
    """B(tau)/K of a put for 0 <= tau <= expiry."""

    segment: Segment  # the put's whole life
    limit: float  # B(0+)/K
    coefficients: Vector  # ln(B/limit)**2 in Chebyshev polynomials of 2 sqrt(tau/expiry) - 1

    def at(self, tau: Vector) -> Vector:
        """Return B(tau)/K, shape of tau."""
        return _boundary_from(self.limit, _basis(tau, self.segment.end), self.coefficients)


@dataclass(frozen=True, slots=True, eq=False)
class PutValues:
    """Value, delta and gamma of puts with strike 1."""

    value: Vector
    delta: Vector
    gamma: Vector


def solve_put_boundary(market: Market, expiry: float) -> PutBoundary:
    """Solve for the exercise boundary of a put; rate and volatility > 0, dividend_yield >= 0.

    Raises
    ------
    NumericalError
        The fixed-point iteration does not converge.
    """
    (segment,) = Book.of([(Option("put", 1.0, expiry), market)]).segments_of()
    rate, dividend_yield, volatility = segment.rate, segment.dividend_yield, segment.volatility
    limit = math.exp(region_at_expiry(segment, is_put=True).upper)
    chebyshev = np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)  # the last belongs to tau = 0
    to_coefficients = np.linalg.inv(chebvander(chebyshev, DEGREE))
    system = _SystemA.discretise(segment, limit, expiry * (0.5 * (1.0 + chebyshev[:-1])) ** 2)
    lowest = perpetual_boundary(is_put=True, rate=rate, dividend_yield=dividend_yield, volatility=volatility)
    logarithm = np.maximum(-volatility * np.sqrt(system.tau), math.log(lowest / limit))
    for _ in range(MOST_ITERATIONS):
        coefficients = to_coefficients @ np.append(np.square(logarithm), 0.0)
        following = np.minimum(np.log(system.right_side(logarithm, coefficients) / limit), 0.0)
        change = float(np.max(np.abs(following - logarithm)))
        if change <= CONVERGED:
            return PutBoundary(segment, limit, coefficients)
        logarithm = following
    raise NumericalError(
        f"the exercise boundary still moves by {change:.1e} after {MOST_ITERATIONS} iterations"
    )


def put_values(boundary: PutBoundary, spots: Vector) -> PutValues:
    """Return value, delta and gamma for spots above the boundary, in units of the strike."""
    segment, expiry = boundary.segment, boundary.segment.end
    rate, dividend_yield = segment.rate, segment.dividend_yield
    S = spots[:, None]
    u, s, weights = _quadrature(np.array([expiry]), VALUE_POINTS)
    B = boundary.at(u[0])
    d2, d1, spread = _distances(segment, S / B, s)
    bond, share = np.exp(-rate * s), np.exp(-dividend_yield * s)
    density = bond * _density(d2) / (S * spread)
    value = rate * bond * ndtr(-d2) - dividend_yield * S * share * ndtr(-d1)
    delta = (dividend_yield * B - rate) * density - dividend_yield * share * ndtr(-d1)
    slope = -(1.0 + d2 / spread) / S  # derivative of ln(density)
    gamma = (dividend_yield * B - rate) * density * slope + dividend_yield * B / S * density
    d2, d1, spread = _distances(segment, spots, np.array(expiry))
    bond, share = np.exp(-rate * expiry), np.exp(-dividend_yield * expiry)
    return PutValues(
        bond * ndtr(-d2) - spots * share * ndtr(-d1) + value @ weights[0],
        -share * ndtr(-d1) + delta @ weights[0],
        share * _density(d1) / (spots * spread) + gamma @ weights[0],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _SystemA:
    """B = N(B)/D(B) at times tau, with the quadrature that its integrals need."""

    segment: Segment
    limit: float
    tau: Vector  # (m,)
    u: Matrix  # (m, points)
    s: Matrix  # tau - u
    weights: Matrix
    basis: NDArray[np.float64]  # (m, points, DEGREE + 1), the Chebyshev polynomials at u

    @classmethod
    def discretise(cls, segment: Segment, limit: float, tau: Vector) -> "_SystemA":
        u, s, weights = _quadrature(tau, BOUNDARY_POINTS)
        return cls(segment, limit, tau, u, s, weights, _basis(u, segment.end))

    def right_side(self, logarithm: Vector, coefficients: Vector) -> Vector:
        """Return N/D for the boundary limit e^logarithm at tau, and its polynomial's coefficients."""
        segment, tau = self.segment, self.tau
        rate, dividend_yield = segment.rate, segment.dividend_yield
        B = self.limit * np.exp(logarithm)
        before = _boundary_from(self.limit, self.basis, coefficients)
        d2, d1, spread = _distances(segment, B[:, None] / before, self.s)
        e2, e1, whole = _distances(segment, B, tau)
        earned = np.exp(rate * self.u) * _density(d2) / spread
        forgone = np.exp(dividend_yield * self.u) * (ndtr(d1) + _density(d1) / spread)
        numerator = _density(e2) / whole + rate * np.sum(self.weights * earned, axis=1)
        denominator = ndtr(e1) + _density(e1) / whole
        denominator += dividend_yield * np.sum(self.weights * forgone, axis=1)
        return np.asarray(np.exp((dividend_yield - rate) * tau) * numerator / denominator)


def _basis(tau: Vector, expiry: float) -> NDArray[np.float64]:
    """Return the Chebyshev polynomials at tau, shape (*tau.shape, DEGREE + 1)."""
    return np.asarray(chebvander(2.0 * np.sqrt(tau / expiry) - 1.0, DEGREE), dtype=np.float64)


def _boundary_from(limit: float, basis: Vector, coefficients: Vector) -> Vector:
    return np.asarray(limit * np.exp(-np.sqrt(np.maximum(basis @ coefficients, 0.0))))


def _quadrature(tau: Vector, points: int) -> tuple[Matrix, Matrix, Matrix]:
    """Return u, tau - u and the weights of a Gauss rule on (0, tau) in phi, each of shape (len(tau), points)."""
    nodes, weights = _gauss_rule(points)
    phi = 0.25 * math.pi * (nodes + 1.0)
    sine, cosine = np.sin(phi), np.cos(phi)
    whole = tau[:, None]
    return whole * sine**2, whole * cosine**2, whole * (0.5 * math.pi * weights * sine * cosine)


@cache
def _gauss_rule(points: int) -> tuple[Vector, Vector]:
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes, weights


def _distances(segment: Segment, ratio: Vector, time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return d2, d1 and sigma sqrt(time)."""
    spread = segment.volatility * np.sqrt(time)
    d2 = (np.log(ratio) + (segment.rate - segment.dividend_yield) * time) / spread - 0.5 * spread
    return d2, d2 + spread, spread


def _density(d: Vector) -> Vector:
    return np.asarray(ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * np.square(d)))
