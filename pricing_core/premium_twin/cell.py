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
    third: Vector  # G_xixixi
    growth: Vector  # e^y
    by_rate: Vector
    by_dividend: Vector
    by_spread: Vector

    def tangents(self) -> tuple[Vector, Vector, Vector]:
        """Return the derivatives by rate, dividend and spread at fixed xi and t."""
        return self.by_rate, self.by_dividend, self.by_spread

    def slope_tangents(self, spread: Vector) -> tuple[Vector, Vector, Vector]:
        """Return those of G_xi."""
        by_spread = self.slope / spread + spread * self.by_spread
        return np.zeros_like(spread), spread * self.by_dividend, by_spread


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
    curvature = spread * slope - spread * (density / root)
    return Obstacle(
        value=(rate_growth - growth * dividend_growth) - (in_stock - in_bond),
        slope=slope,
        curvature=curvature,
        third=spread * curvature + spread * (d2 * (density / t)),
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

        w'' = 2 h,   w''' = 2 (h_xi - 2 h v),   w'''' = 2 (h_xixi + 2 h_t + 4 h v**2),
        w''''' = 2 (h_xixixi + 2 h_xit - 8 h_t v - 4 h_xi v**2 - 8 h v**3),

    v the velocity; the last leaves out a multiple of v's derivative.

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

    def solve(self, eliminated: Vector, guess: Vector, blind: bool) -> tuple[Vector, Vector]:
        """Return the value at label 0 and phi, by Newton's method from y_1; `blind` guesses take one step more."""
        self.known = self.there.value - eliminated - self.pi * self.here.value
        phi = guess
        for _ in range(ITERATIONS + blind):
            at = self._residual(phi, self.known)
            move = np.where(at.derivative == 0.0, 0.0, -at.value / at.derivative)
            phi = phi + np.maximum(np.minimum(move, self.most), -self.most)
            phi = np.maximum(np.minimum(phi, 2.0 * self.most), -2.0 * self.most)
        return self.here.value + self._residual(phi, self.known).contact, phi

    def _stock_at(self, phi: Vector) -> Vector:
        """Return e^{y + dividend t} at the boundary, e^{spread phi dx} by its series."""
        d = self.spread * self.dx * phi
        return self.stock * (1.0 + d * (1.0 + d * (0.5 + d * (1.0 / 6.0 + d * (1.0 / 24.0)))))

    def _residual(self, phi: Vector, known: Vector) -> "_Residual":
        v = self.velocity + self.turn * phi
        earned, paid = self.rate * self.bond, self.dividend * self._stock_at(phi)
        h = earned - paid
        h_xi = -(self.spread * paid)
        squared = self.spread * self.spread
        h_t = self.rate * earned - paid * (0.5 * squared + self.dividend)
        third = (h_xi - 2.0 * (h * v)) / 3.0
        fourth = (4.0 * (h * (v * v)) + 2.0 * h_t + self.spread * h_xi) / 12.0
        curved = 2.0 * (h_t + h * (v * v)) + h_xi * v
        fifth = (h_xi * 2.0 * (squared + self.dividend) - 4.0 * (v * curved)) / 60.0
        z0 = -(phi * self.dx)
        z1 = z0 + self.dx
        # The velocity is in the coefficients of z**3, z**4 and z**5.
        turned = (2.0 / 3.0 * self.turn) * h
        turned_fifth = (-2.0 / 15.0 * self.turn) * (h_t + h_xi * v + 3.0 * (h * (v * v)))
        w, by = [], []
        for z in (z0, z1):
            w.append(z * z * (h + z * (third + z * (fourth + z * fifth))))
            slope = z * (2.0 * h + z * (3.0 * third + z * (4.0 * fourth + z * (5.0 * fifth))))
            by.append(z * z * z * (turned * (z * v - 1.0) + turned_fifth * (z * z)) - self.dx * slope)
        return _Residual(w[0], by[0], known + (w[1] - self.pi * w[0]), by[1] - self.pi * by[0])

    def tangents(
        self, eliminated: Matrix, phi: Vector, place_by: Matrix, velocity_by: Matrix
    ) -> tuple[Matrix, Matrix]:
        """Return the derivatives of u at label 0, and of phi, by rate, dividend and spread, each of shape (3, rows).

        The conditions differentiated: first what moves u_0 and u_1 at a fixed phi (the first three terms of w are
        enough: phi is small), then phi.

        Parameters
        ----------
        eliminated : Matrix
            Those of y_1.
        phi : Vector
            As solved.
        place_by, velocity_by : Matrix
            Those of xi_0, and of the velocity at a fixed phi.
        """
        at = self._residual(phi, self.known)
        v = self.velocity + self.turn * phi
        stock = self._stock_at(phi)
        earned, paid = self.rate * self.bond, self.dividend * stock
        h, c = earned - paid, 0.5 * (self.spread * self.spread) + self.dividend
        held = 1.0 + self.rate * self.t
        earned_by = (self.bond * held, 0.0, 0.0)
        moving = self.spread * paid  # by the place
        paid_by = (
            moving * place_by[0],
            moving * place_by[1] + stock * (1.0 + self.dividend * self.t),
            moving * place_by[2] + paid * (self.xi + phi * self.dx + self.spread * self.t),
        )
        h_t_by = (
            earned * (1.0 + held) - c * paid_by[0],
            -(c * paid_by[1] + paid),
            -(c * paid_by[2] + self.spread * paid),
        )
        z0 = -(phi * self.dx)
        z1 = z0 + self.dx
        values, places = [], []
        for j, (g0, g1) in enumerate(zip(self.here.tangents(), self.there.tangents(), strict=True)):
            h_by = earned_by[j] - paid_by[j]
            more = paid if j == 2 else 0.0
            h_xi_by = -(self.spread * paid_by[j] + more)
            third = (h_xi_by - 2.0 * (h_by * v + h * velocity_by[j])) / 3.0
            bent = 4.0 * (v * (h_by * v + 2.0 * (h * velocity_by[j])))
            fourth = (bent + 2.0 * h_t_by[j] - self.spread * (self.spread * paid_by[j] + 2.0 * more)) / 12.0
            u0 = g0 + self.here.slope * place_by[j] + z0 * z0 * (h_by + z0 * (third + z0 * fourth))
            u1 = g1 + self.there.slope * place_by[j] + z1 * z1 * (h_by + z1 * (third + z1 * fourth))
            moved = (eliminated[j] + self.pi * u0 - u1) / at.derivative
            values.append(u0 + at.slope * moved)
            places.append(moved)
        return np.stack(values), np.stack(places)


@dataclass(frozen=True, slots=True, eq=False)
class _Residual:
    """w_0 and its derivative by phi; w_1 - pi w_0 + known and its own."""

    contact: Vector
    slope: Vector
    value: Vector
    derivative: Vector
