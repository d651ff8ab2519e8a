"""The cell of the exercise boundary: its obstacle, and the complementarity problem solved to the boundary's place.

Notation of `march`: xi, t, labels dx apart, u >= G.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import erfcx

from pricing_core.arrays import Matrix, Vector

ITERATIONS = 2
LARGEST_MOVE = 0.6  # of sqrt(t), per iteration, for the boundary
ONE_OVER_SQRT_TWO_PI = 0.3989422804014327
SQRT_HALF_PI = 1.2533141373155003
SQRT_HALF = 0.7071067811865476


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """G = expm1(rate t) - e^y expm1(dividend t) - e^y N(d1) + N(d2) with its derivatives; fields have shape (rows,).

    y = xi spread + spread**2 t/2, d2 = xi/sqrt(t), d1 = d2 + spread sqrt(t). In money: e^{r tau} times payoff less
    European put, over the strike.
    """

    value: Vector
    slope: Vector  # G_xi
    curvature: Vector  # G_xixi
    growth: Vector  # e^y
    by_rate: Vector
    by_dividend: Vector
    by_spread: Vector

    def tangents(self) -> tuple[Vector, Vector, Vector]:
        """Return the derivatives by rate, dividend and spread at fixed xi and t."""
        return self.by_rate, self.by_dividend, self.by_spread


def obstacle_at(
    rate: Vector, dividend: Vector, spread: Vector, xi: Vector, t: float, root: float
) -> Obstacle:
    """Evaluate the obstacle; `root` is sqrt(t)."""
    growth = np.exp(xi * spread + (0.5 * t) * (spread * spread))
    d2 = xi / root
    d1 = d2 + spread * root
    density = ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * (d2 * d2))  # of d2; e^y times that of d1
    in_stock = np.where(
        d1 < 0.0, density * mills_ratio(np.abs(d1)), growth - density * mills_ratio(np.abs(d1))
    )
    in_bond = np.where(d2 < 0.0, density * mills_ratio(np.abs(d2)), 1.0 - density * mills_ratio(np.abs(d2)))
    rate_growth, dividend_growth = np.expm1(rate * t), np.expm1(dividend * t)
    held = growth * dividend_growth + in_stock
    slope = -(spread * held)
    return Obstacle(
        value=(rate_growth - growth * dividend_growth) - (in_stock - in_bond),
        slope=slope,
        curvature=spread * slope - spread * (density / root),
        growth=growth,
        by_rate=t * (1.0 + rate_growth),
        by_dividend=-(t * (growth * (1.0 + dividend_growth))),
        by_spread=-((xi + spread * t) * held) - root * density,
    )


def mills_ratio(y: Vector) -> Vector:
    """Return N(-y) / N'(y) for y >= 0."""
    return np.asarray(SQRT_HALF_PI * erfcx(SQRT_HALF * y))


class Cell:
    """The problem of one stage: u at label 0 and the boundary xi_f = xi_0 + phi dx.

    The elimination says u_1 = y_1 + pi u_0; the complementarity conditions say the rest.

    On the free side w = u - G obeys w_t = w_xixi/2 - h with h = rate e^{rate t} - dividend e^{y + dividend t}, and
    w = w_xi = 0 at the boundary, which moves with velocity + phi `turn`. Along it that gives w's Taylor series:

        w'' = 2 h,   w''' = 2 (h_xi - 2 h velocity),   w'''' = 2 (4 h velocity**2 + 2 h_t + h_xixi).

    h > 0 is what the held side pays for waiting: with w >= 0 beyond the boundary this is the complementarity problem.
    """

    def __init__(
        self,
        rate: Vector,
        dividend: Vector,
        spread: Vector,
        xi: Vector,
        t: float,
        root: float,
        dx: float,
        velocity: Vector,
        turn: float,
        pi: Vector,
    ) -> None:
        self.rate, self.dividend, self.spread = rate, dividend, spread
        self.xi, self.t, self.dx, self.velocity, self.turn, self.pi = xi, t, dx, velocity, turn, pi
        self.here = obstacle_at(rate, dividend, spread, xi, t, root)
        self.there = obstacle_at(rate, dividend, spread, xi + dx, t, root)
        self.bond = 1.0 + np.expm1(rate * t)
        self.stock = self.here.growth * (1.0 + np.expm1(dividend * t))
        self.most = LARGEST_MOVE * root / dx

    def solve(self, eliminated: Matrix, guess: Vector, blind: bool) -> tuple[Matrix, Vector]:
        """Return the values at label 0, shape (1 or 4, rows), and phi, by Newton's method from y_1.

        `blind` guesses take one step more.
        """
        known = self.there.value - eliminated[0] - self.pi * self.here.value
        phi = guess
        for _ in range(ITERATIONS + blind):
            at = self._residual(phi, known)
            move = np.where(at.derivative == 0.0, 0.0, -at.value / at.derivative)
            phi = phi + np.maximum(np.minimum(move, self.most), -self.most)
            phi = np.maximum(np.minimum(phi, 2.0 * self.most), -2.0 * self.most)
        at = self._residual(phi, known)
        values = [self.here.value + at.contact]
        if eliminated.shape[0] > 1:
            values += self._tangents(eliminated, phi, at)
        return np.stack(values), phi

    def _stock_at(self, phi: Vector) -> Vector:
        """Return e^{y + dividend t} at the boundary, e^{spread phi dx} by its series."""
        d = self.spread * self.dx * phi
        return self.stock * (1.0 + d * (1.0 + d * (0.5 + d * (1.0 / 6.0 + d * (1.0 / 24.0)))))

    def _residual(self, phi: Vector, known: Vector) -> "_Residual":
        v = self.velocity + self.turn * phi
        earned, paid = self.rate * self.bond, self.dividend * self._stock_at(phi)
        h = earned - paid
        h_xi = -(self.spread * paid)
        h_t = self.rate * earned - paid * (0.5 * (self.spread * self.spread) + self.dividend)
        third = (h_xi - 2.0 * (h * v)) / 3.0
        fourth = (4.0 * (h * (v * v)) + 2.0 * h_t + self.spread * h_xi) / 12.0
        z0 = -(phi * self.dx)
        z1 = z0 + self.dx
        turned = (2.0 / 3.0 * self.turn) * h
        w, by = [], []
        for z in (z0, z1):
            w.append(z * z * (h + z * (third + z * fourth)))
            slope = z * (2.0 * h + z * (3.0 * third + z * (4.0 * fourth)))
            # The velocity is in the coefficients of z**3 and z**4.
            by.append(turned * (z * z * z) * (z * v - 1.0) - self.dx * slope)
        return _Residual(w[0], by[0], known + (w[1] - self.pi * w[0]), by[1] - self.pi * by[0])

    def _tangents(self, eliminated: Matrix, phi: Vector, at: "_Residual") -> list[Vector]:
        """Return the derivatives of u at label 0: the conditions differentiated, the label held.

        First what moves u_0 and u_1 at a fixed boundary, h' z**2 and its successor, then the boundary.
        """
        stock, v = self._stock_at(phi), self.velocity + self.turn * phi
        paid = self.dividend * stock
        by_rate = self.bond * (1.0 + self.rate * self.t)
        by_dividend = -(stock * (1.0 + self.dividend * self.t))
        by_spread = -(paid * (self.xi + phi * self.dx + self.spread * self.t))
        sources = (
            (by_rate, -2.0 / 3.0 * (by_rate * v)),
            (by_dividend, by_dividend * (self.spread - 2.0 * v) / 3.0),
            (by_spread, (by_spread * (self.spread - 2.0 * v) - paid) / 3.0),
        )
        z0 = -(phi * self.dx)
        z1 = z0 + self.dx
        found = []
        for j, (g0, g1) in enumerate(zip(self.here.tangents(), self.there.tangents(), strict=True)):
            bend, third = sources[j]
            u0 = g0 + z0 * z0 * (bend + z0 * third)
            u1 = g1 + z1 * z1 * (bend + z1 * third)
            moved = (eliminated[j + 1] + self.pi * u0 - u1) / at.derivative
            found.append(u0 + at.slope * moved)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Residual:
    """w_0 and its derivative by phi; w_1 - pi w_0 + known and its own."""

    contact: Vector
    slope: Vector
    value: Vector
    derivative: Vector
