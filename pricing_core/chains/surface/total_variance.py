"""Smiles of several expiries as splines, and the total variance in between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smile_basis import SmileBasis

NOWHERE = Jet(math.nan, math.nan, math.nan)  # A smile that is not asked for.


@dataclass(frozen=True)
class TotalVariance:
    """w(x, T): at the expiry T_i the spline theta_i sum_j c_ij B_j(x/sqrt(theta_i)), in between monotone in T.

    ln w is a cubic in ln T between two expiries, with the slopes of Fritsch and Butland (1984): monotone where the
    smiles do not cross, with derivatives that are continuous. Before the first expiry w is proportional to T, which
    keeps a smile without butterfly arbitrage so; after the last it grows by the same amount at all x, theta_m/T_m a
    year.

    Parameters
    ----------
    basis : SmileBasis
    expiries : Vector, shape (m,)
        Years, increasing.
    theta : Vector, shape (m,)
        Units of the smiles.
    coefficients : Matrix, shape (m, n)
    """

    basis: SmileBasis
    expiries: Vector
    theta: Vector
    coefficients: Matrix

    def smile(self, i: int, x: Vector) -> Jet:
        """Return w and its derivatives by x at the i-th expiry, each of shape (k,)."""
        root = math.sqrt(self.theta[i])
        splines = self.basis.jets(np.asarray(x, dtype=np.float64) / root)
        c = self.coefficients[i]
        unit = float(self.theta[i])
        return Jet(unit * (splines.value @ c), root * (splines.first @ c), splines.second @ c)

    def smiles(self, x: Vector) -> list[Jet]:
        """Return those of all expiries."""
        return [self.smile(i, x) for i in range(self.expiries.size)]

    def at(self, x: Vector, time: float) -> tuple[Jet, Vector]:
        """Return w and its derivatives by x, and the one by T, at k places, each of shape (k,)."""
        needed = window(self.expiries, time)
        smiles = [self.smile(i, x) if i in needed else NOWHERE for i in range(self.expiries.size)]
        return between_expiries(self.expiries, smiles, time, self.growth)

    @property
    def growth(self) -> float:
        """What total variance grows by in a year after the last expiry."""
        return float(self.theta[-1] / self.expiries[-1])


def window(expiries: Vector, time: float) -> range:
    """Return the indices of the expiries on which the total variance at a time depends."""
    if time < expiries[0] or expiries.size == 1:
        return range(1)
    if time > expiries[-1]:
        return range(expiries.size - 1, expiries.size)
    i = _interval(expiries, time)
    return range(max(i - 1, 0), min(i + 3, expiries.size))


def between_expiries(expiries: Vector, smiles: list[Jet], time: float, growth: float) -> tuple[Jet, Vector]:
    """Return total variance and its derivative by T at a time, from the smiles at the expiries."""
    if time < expiries[0] or time == expiries[0] == expiries[-1]:
        share = time / expiries[0]
        return smiles[0].times(share), smiles[0].value / expiries[0]
    if time > expiries[-1]:
        last = smiles[-1]
        added = Jet((time - expiries[-1]) * growth, 0.0, 0.0)
        return last + added, np.full_like(last.value, growth)
    return _between(expiries, smiles, time)


def _between(expiries: Vector, smiles: list[Jet], time: float) -> tuple[Jet, Vector]:
    """Return what the monotone cubic gives."""
    i, places = _interval(expiries, time), np.log(expiries)
    logs = {j: smiles[j].log() for j in window(expiries, time)}
    widths = {j: float(places[j + 1] - places[j]) for j in logs if j + 1 in logs}
    secants = {j: (logs[j + 1] - logs[j]).times(1.0 / widths[j]) for j in widths}
    low, high = _slopes(i, secants, widths)
    t = (math.log(time) - places[i]) / widths[i]
    rise = t * t * (3.0 - 2.0 * t)
    level = logs[i].times(1.0 - rise) + logs[i + 1].times(rise)
    level = level + low.times(widths[i] * t * (1.0 - t) ** 2) - high.times(widths[i] * t * t * (1.0 - t))
    slope = secants[i].times(6.0 * t * (1.0 - t)) + low.times((1.0 - t) * (1.0 - 3.0 * t))
    slope = slope + high.times(t * (3.0 * t - 2.0))
    variance = level.exp()
    return variance, variance.value * slope.value / time


def _interval(expiries: Vector, time: float) -> int:
    """Return the index of the expiry at or before a time, one less at the last."""
    return min(int(np.searchsorted(expiries, time, side="right")) - 1, expiries.size - 2)


def _slopes(i: int, secants: dict[int, Jet], widths: dict[int, float]) -> tuple[Jet, Jet]:
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


def _harmonic(left: Jet, right: Jet, left_width: float, right_width: float) -> Jet:
    """Return the weighted harmonic mean of two secants above 0."""
    first, second = left_width + 2.0 * right_width, 2.0 * left_width + right_width
    both = left.reciprocal().times(first) + right.reciprocal().times(second)
    return both.reciprocal().times(first + second)


def _end(secant: Jet, other: Jet) -> Jet:
    """Return the slope at an end, of second order and between 0 and 3 secants: d e^(1 - m/d)."""
    ratio = (other * secant.reciprocal()).times(-1.0) + Jet(1.0, 0.0, 0.0)
    return secant * ratio.exp()
