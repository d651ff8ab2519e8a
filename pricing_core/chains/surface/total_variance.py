"""Smiles of several expiries as splines, and the total variance in between.

Where cash dividends are due, the volatility of the martingale X, sigma_X = sigma S/(S - D), jumps with D though that of
the spot, sigma, does not. What is interpolated in between is therefore a function of

    tau(x, T) = the integral of (S/(S - D))^2 at X = e^x over time = T + 2 C_1 e^-x + C_2 e^-2x,

C_1 and C_2 the integrals of D/(F - D) and of its square: X at x then runs at the pace of a spot of constant volatility.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smile_basis import SmileBasis

NOWHERE = Jet(math.nan, math.nan, math.nan)  # A smile that is not asked for.


@dataclass(frozen=True)
class Clock:
    """The time tau(x, T), see above, from D/(F - D), which is constant between dividends.

    Parameters
    ----------
    times : tuple of float, increasing
        At which the ratio jumps, years.
    ratios : tuple of float, one more
        D/(F - D) before each of them, and after the last.
    """

    times: tuple[float, ...] = ()
    ratios: tuple[float, ...] = (0.0,)

    def at(self, x: Vector, time: float) -> tuple[Jet, Vector]:
        """Return tau and its derivatives by x, and the one by T (from the right), each of shape (k,)."""
        ends = np.minimum([*self.times, math.inf], time)
        lengths, ratios = np.diff(ends, prepend=0.0), np.array(self.ratios)
        now = float(ratios[np.searchsorted(self.times, time, side="right")])
        far, double = np.exp(-x), np.exp(-2.0 * x)
        one, two = 2.0 * float(lengths @ ratios) * far, float(lengths @ ratios**2) * double
        return Jet(time + one + two, -one - 2.0 * two, one + 4.0 * two), (1.0 + now * far) ** 2


@dataclass(frozen=True)
class TotalVariance:
    """The total variance w(x, T), monotone in T between the expiries.

    At the expiry T_i it is the spline theta_i sum_j c_ij B_j(x/sqrt(theta_i)).
    ln w is a cubic in ln tau between two expiries, with the slopes of Fritsch and Butland (1984): monotone where the
    smiles do not cross, with derivatives that are continuous. Before the first expiry w is proportional to tau, which
    without dividends keeps a smile without butterfly arbitrage so; after the last it grows by the same amount at all x,
    theta_m/T_m a year.

    Parameters
    ----------
    basis : SmileBasis
    expiries : Vector, shape (m,)
        Years, increasing.
    theta : Vector, shape (m,)
        Units of the smiles.
    coefficients : Matrix, shape (m, n)
    clock : Clock
    """

    basis: SmileBasis
    expiries: Vector
    theta: Vector
    coefficients: Matrix
    clock: Clock = Clock()

    def smile(self, i: int, x: Vector) -> Jet:
        """Return w and its derivatives by x at the i-th expiry, each of shape (k,)."""
        root = math.sqrt(self.theta[i])
        splines = self.basis.jets(np.asarray(x, dtype=np.float64) / root)
        c = self.coefficients[i]
        unit = float(self.theta[i])
        return Jet(unit * (splines.value @ c), root * (splines.first @ c), splines.second @ c)

    def smiles(self, x: Vector) -> list[Jet]:
        """Return w and its derivatives by x at every expiry."""
        return [self.smile(i, x) for i in range(self.expiries.size)]

    def at(self, x: Vector, time: float) -> tuple[Jet, Vector]:
        """Return w and its derivatives by x, and the one by T, at k places, each of shape (k,)."""
        needed = window(self.expiries, time)
        smiles = [self.smile(i, x) if i in needed else NOWHERE for i in range(self.expiries.size)]
        return self.between(smiles, x, time)

    def between(self, smiles: list[Jet], x: Vector, time: float) -> tuple[Jet, Vector]:
        """Return total variance and its derivative by T at a time, from the smiles at the expiries."""
        expiries, last = self.expiries, smiles[-1]
        if time > expiries[-1]:
            growth = float(self.theta[-1] / expiries[-1])
            return last + Jet((time - expiries[-1]) * growth, 0.0, 0.0), np.full_like(last.value, growth)
        tau, pace = self.clock.at(x, time)
        if time < expiries[0] or time == expiries[0] == expiries[-1]:
            share = smiles[0] * self.clock.at(x, float(expiries[0]))[0].reciprocal()
            return share * tau, share.value * pace
        i = _interval(expiries, time)
        places = {j: self.clock.at(x, float(expiries[j]))[0].log() for j in window(expiries, time)}
        variance, slope = _cubic(i, {j: smiles[j].log() for j in places}, places, tau.log())
        return variance, variance.value * slope * pace / tau.value


def joined(early: TotalVariance, late: TotalVariance) -> TotalVariance:
    """Return the smiles of two functions on the same splines as those of one."""
    expiries, theta = (
        np.concatenate([getattr(each, name) for each in (early, late)]) for name in ("expiries", "theta")
    )
    return TotalVariance(early.basis, expiries, theta, np.vstack([early.coefficients, late.coefficients]))


def window(expiries: Vector, time: float) -> range:
    """Return the indices of the expiries on which the total variance at a time depends."""
    if time < expiries[0] or expiries.size == 1:
        return range(1)
    if time > expiries[-1]:
        return range(expiries.size - 1, expiries.size)
    i = _interval(expiries, time)
    return range(max(i - 1, 0), min(i + 3, expiries.size))


def _cubic(i: int, logs: dict[int, Jet], places: dict[int, Jet], place: Jet) -> tuple[Jet, Vector]:
    """Return what the monotone cubic gives between the i-th place and the next, and the slope of its logarithm."""
    widths = {j: places[j + 1] - places[j] for j in logs if j + 1 in logs}
    secants = {j: (logs[j + 1] - logs[j]) * widths[j].reciprocal() for j in widths}
    low, high = _slopes(i, secants, widths)
    one = Jet(1.0, 0.0, 0.0)
    t = (place - places[i]) * widths[i].reciprocal()
    left = one - t
    rise = t * t * (Jet(3.0, 0.0, 0.0) - t.times(2.0))
    bend = widths[i] * t * left
    level = logs[i] * (one - rise) + logs[i + 1] * rise + bend * (low * left - high * t)
    inner, share = t.value, left.value
    slope = 6.0 * inner * share * secants[i].value
    slope = slope + share * (1.0 - 3.0 * inner) * low.value + inner * (3.0 * inner - 2.0) * high.value
    return level.exp(), slope


def _interval(expiries: Vector, time: float) -> int:
    """Return the index of the expiry at or before a time, one less at the last."""
    return min(int(np.searchsorted(expiries, time, side="right")) - 1, expiries.size - 2)


def _slopes(i: int, secants: dict[int, Jet], widths: dict[int, Jet]) -> tuple[Jet, Jet]:
    """Return the slopes at both ends of an interval."""
    own = secants[i]
    low = _harmonic(secants[i - 1], own, widths[i - 1], widths[i]) if i - 1 in secants else None
    high = _harmonic(own, secants[i + 1], widths[i], widths[i + 1]) if i + 1 in secants else None
    if low is None and high is None:
        return own, own
    if low is None:
        assert high is not None
        return _end(own, high), high
    return low, _end(own, low) if high is None else high


def _harmonic(left: Jet, right: Jet, left_width: Jet, right_width: Jet) -> Jet:
    """Return the weighted harmonic mean of two secants above 0."""
    first, second = left_width + right_width.times(2.0), left_width.times(2.0) + right_width
    both = left.reciprocal() * first + right.reciprocal() * second
    return both.reciprocal() * (first + second)


def _end(secant: Jet, other: Jet) -> Jet:
    """Return the slope at an end, of second order and between 0 and 3 secants: d e^(1 - m/d)."""
    ratio = (other * secant.reciprocal()).times(-1.0) + Jet(1.0, 0.0, 0.0)
    return secant * ratio.exp()
