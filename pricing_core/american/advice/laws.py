"""The law of the logarithm of the spot of holders who have not exercised: a point, or a density on panels.

Both can be asked what they become when a normal increment is added, and both can be mirrored, so that what is written
for a region below a holder serves a region above.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.special import ndtr

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

ORDER = 12  # Number of Gauss points in a panel; chosen.
REACH = 9.0  # Standard deviations beyond which a normal law has no mass; chosen.
RESOLVED = 1e-9  # Largest share of a density's peak that a panel's last coefficients may have; chosen.
NEGLIGIBLE = 1e-14  # Largest share of a density's peak that is cut off at its ends; chosen.
TAIL = 40.0  # Reach of a density below the logarithm of a payment that takes the spot to zero; chosen.
FIRST_PANELS, MOST_PANELS = 8, 512  # Numbers of panels to begin with, and at most; chosen.
UNRESOLVED = 1e-8  # Largest share of the mass in what the largest number of panels does not resolve; chosen.
# Numbers of places that a function is asked for together, and of pieces that are integrated together: they bound the
# memory that is taken at a time; chosen.
PLACES, PIECES = 512, 8_192

TOO_NARROW = (
    "the law of the spot changes too sharply to be resolved: the volatility is too small against the rest"
)

NODES, WEIGHTS = np.polynomial.legendre.leggauss(ORDER)
_VANDERMONDE = np.polynomial.legendre.legvander(NODES, ORDER - 1)
TO_COEFFICIENTS = (_VANDERMONDE * WEIGHTS[:, None]) * (np.arange(ORDER) + 0.5)  # values at the nodes @ this
_PARTS = np.array(
    [-9.0, -6.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 6.0, 9.0]
)  # Where a normal kernel is cut.


class Law(Protocol):
    """What a point mass and a density both provide; `level`, `place`, `mean` and `spread` have the shape (n,)."""

    @property
    def mass(self) -> float:
        """The total mass, a share of 1."""
        ...

    @property
    def support(self) -> tuple[float, float]:
        """The two ends of the interval that holds the mass."""
        ...

    def below(self, level: Vector, mean: Vector, spread: Vector) -> Vector:
        """Return the mass at most at each level when a normal increment is added."""
        ...

    def density(self, place: Vector, mean: float, spread: float) -> Vector:
        """Return the density at each place when a normal increment is added."""
        ...

    def mirrored(self) -> Law:
        """Return the law of -X."""
        ...

    def moved(self, by: float) -> Law:
        """Return the law of X + by."""
        ...

    def after_cash(self, gone: float) -> Law | None:
        """Return the law of ln(e^X - e^gone) where X > gone; None where no mass lies there."""
        ...

    def between(self, low: float, high: float) -> Law | None:
        """Return what lies between two levels, both included; None where nothing does."""
        ...


def normal_density(x: Matrix) -> Matrix:
    """Return the standard normal density."""
    return np.asarray(np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi))


@dataclass(frozen=True, slots=True)
class PointMass:
    """A law whose whole mass lies at one point.

    Parameters
    ----------
    place : float
        ln(spot).
    mass : float
    """

    place: float
    mass: float

    @property
    def support(self) -> tuple[float, float]:
        """The point, as both ends of the interval."""
        return self.place, self.place

    def below(self, level: Vector, mean: Vector, spread: Vector) -> Vector:
        """Return the mass at most at each level when a normal increment is added."""
        return np.asarray(self.mass * ndtr((level - self.place - mean) / spread))

    def density(self, place: Vector, mean: float, spread: float) -> Vector:
        """Return the density at each place when a normal increment is added."""
        return self.mass / spread * normal_density((place - self.place - mean) / spread)

    def mirrored(self) -> PointMass:
        """Return the law of -X."""
        return PointMass(-self.place, self.mass)

    def moved(self, by: float) -> PointMass:
        """Return the law of X + by."""
        return PointMass(self.place + by, self.mass)

    def after_cash(self, gone: float) -> PointMass | None:
        """Return the law of ln(e^X - e^gone); None where there is no such number."""
        return PointMass(_less(self.place, gone), self.mass) if self.place > gone else None

    def between(self, low: float, high: float) -> PointMass | None:
        """Return the point where it lies between two levels, else None."""
        return self if low <= self.place <= high else None


@dataclass(frozen=True, eq=False)
class Density:
    """A density that is a polynomial on each of its panels.

    Parameters
    ----------
    breaks : Vector, shape (k + 1,)
        Increasing ends of the panels, in ln(spot); the density is 0 outside.
    values : Matrix, shape (k, ORDER)
        At the Gauss points of each panel.
    """

    breaks: Vector
    values: Matrix

    @cached_property
    def mass(self) -> float:
        """The integral of the density."""
        return float(0.5 * np.diff(self.breaks) @ (self.values @ WEIGHTS))

    @property
    def support(self) -> tuple[float, float]:
        """The two ends of the panels."""
        return float(self.breaks[0]), float(self.breaks[-1])

    @cached_property
    def _coefficients(self) -> Matrix:
        return np.asarray(self.values @ TO_COEFFICIENTS)

    def at(self, place: Vector) -> Vector:
        """Return the density at each place, shape (n,)."""
        panel = np.clip(np.searchsorted(self.breaks, place, side="right") - 1, 0, self.breaks.size - 2)
        low, high = self.breaks[panel], self.breaks[panel + 1]
        terms = np.polynomial.legendre.legvander((2.0 * place - low - high) / (high - low), ORDER - 1)
        inside = (place >= self.breaks[0]) & (place <= self.breaks[-1])
        return np.where(inside, np.einsum("ij,ij->i", terms, self._coefficients[panel]), 0.0)

    def below(self, level: Vector, mean: Vector, spread: Vector) -> Vector:
        """Return the mass at most at each level when a normal increment is added."""
        start = np.full(level.size, self.breaks[0])
        return self._against(level - mean, spread, start, ndtr)

    def density(self, place: Vector, mean: float, spread: float) -> Vector:
        """Return the density at each place when a normal increment is added."""
        wide = np.full(place.size, spread)
        return self._against(place - mean, wide, place - mean - REACH * spread, normal_density) / spread

    def _against(
        self, centre: Vector, spread: Vector, start: Vector, kernel: Callable[[Matrix], Matrix]
    ) -> Vector:
        """Return the integrals of p(x) kernel((centre - x)/spread) over x from `start` on, shape (n,).

        Every one is cut at the panels and where the kernel bends.
        """
        together = max(1, PIECES // (self.breaks.size + _PARTS.size))
        parts = np.arange(together, centre.size, together)
        centres, spreads, starts = (np.split(column, parts) for column in (centre, spread, start))
        some = zip(centres, spreads, starts, strict=True)
        return np.concatenate([self._part_against(*these, kernel) for these in some])

    def _part_against(
        self, centre: Vector, spread: Vector, start: Vector, kernel: Callable[[Matrix], Matrix]
    ) -> Vector:
        bends = centre[:, None] + spread[:, None] * _PARTS
        cuts = np.concatenate([np.broadcast_to(self.breaks, (centre.size, self.breaks.size)), bends], axis=1)
        first = np.maximum(start, self.breaks[0])[:, None]
        last = np.clip(bends[:, -1:], first, np.maximum(self.breaks[-1], first))
        cuts = np.sort(np.clip(cuts, first, last), axis=1)
        row, piece = np.nonzero(np.diff(cuts, axis=1) > 0.0)
        low, half = cuts[row, piece][:, None], 0.5 * (cuts[row, piece + 1] - cuts[row, piece])[:, None]
        places = low + half * (1.0 + NODES)
        heights = self.at(places.ravel()).reshape(places.shape)
        found = (heights * kernel((centre[row, None] - places) / spread[row, None])) @ WEIGHTS * half[:, 0]
        return np.asarray(np.bincount(row, found, minlength=centre.size), dtype=np.float64)

    def mirrored(self) -> Density:
        """Return the law of -X."""
        return Density(-self.breaks[::-1], self.values[::-1, ::-1])

    def moved(self, by: float) -> Density:
        """Return the law of X + by."""
        return Density(self.breaks + by, self.values)

    def after_cash(self, gone: float) -> Density | None:
        """Return the law of ln(e^X - e^gone) where X > gone; None where no mass lies there."""
        kept = self.between(gone, math.inf)
        if kept is None or not kept.mass > 0.0:
            return None

        def density(place: Vector) -> Vector:
            before = np.logaddexp(place, gone)
            return kept.at(before) * np.exp(place - before)

        bottom, top = kept.support
        low = _less(bottom, gone) if bottom > gone else -math.inf
        return resolved(density, max(low, gone - TAIL), _less(top, gone)).with_mass(kept.mass)

    def between(self, low: float, high: float) -> Density | None:
        """Return what lies between two levels; None where nothing does."""
        start, end = max(low, self.breaks[0]), min(high, self.breaks[-1])
        if start >= end:
            return None
        if start == self.breaks[0] and end == self.breaks[-1]:
            return self
        inner = self.breaks[(self.breaks > start) & (self.breaks < end)]
        return _sampled(self.at, np.concatenate([[start], inner, [end]]))

    def with_mass(self, mass: float) -> Density:
        """Return the density scaled to a mass."""
        return Density(self.breaks, self.values * (mass / self.mass))


def resolved(function: Callable[[Vector], Vector], low: float, high: float) -> Density:
    """Return a density on panels that are halved until each resolves the function, low < high.

    Raises
    ------
    NumericalError
        The largest number of panels does not resolve it.
    """
    density = _sampled(function, np.linspace(low, high, FIRST_PANELS + 1))
    while True:
        size = np.abs(density.values @ TO_COEFFICIENTS)[:, -3:].max(axis=1)
        coarse = size > RESOLVED * np.abs(density.values).max()
        if not coarse.any():
            break
        if coarse.sum() + coarse.size > MOST_PANELS:
            if np.diff(density.breaks) @ (size * coarse) <= UNRESOLVED * density.mass:
                break  # rounding alone, where the density is narrow
            raise NumericalError(TOO_NARROW)
        middle = 0.5 * (density.breaks[:-1] + density.breaks[1:])[coarse]
        breaks = np.sort(np.concatenate([density.breaks, middle]))
        halves = np.repeat(coarse, np.where(coarse, 2, 1))
        values = np.repeat(density.values, np.where(coarse, 2, 1), axis=0)
        values[halves] = _values(function, breaks[:-1][halves], breaks[1:][halves])
        density = Density(breaks, values)
    peak = density.values.max(axis=1)
    kept = np.flatnonzero(peak > NEGLIGIBLE * peak.max())
    first, last = (kept[0], kept[-1] + 1) if kept.size else (0, peak.size)
    return Density(density.breaks[first : last + 1], density.values[first:last])


def _less(place: float, gone: float) -> float:
    """Return ln(e^place - e^gone), place > gone."""
    return place + math.log(-math.expm1(gone - place))


def _sampled(function: Callable[[Vector], Vector], breaks: Vector) -> Density:
    return Density(breaks, _values(function, breaks[:-1], breaks[1:]))


def _values(function: Callable[[Vector], Vector], low: Vector, high: Vector) -> Matrix:
    places = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * NODES
    parts = np.split(places.ravel(), np.arange(PLACES, places.size, PLACES))
    heights = np.concatenate([function(part) for part in parts]).reshape(places.shape)
    return np.asarray(np.maximum(heights, 0.0))
