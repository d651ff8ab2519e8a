"""Prices whose volatilities are looked for, and the coordinate in which the search for them is nearly straight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.engines.price_bounds import PriceBounds
from pricing_core.american.implied.black_spread import black_spread, black_time_value
from pricing_core.arrays import BoolVector, Vector

ANY_VOLATILITY = 0.2  # Volatility, 1/sqrt(year), that stands in for the one that is looked for.
LARGEST_MONEYNESS = 600.0  # Largest |ln(F/K)|, so that powers of e do not overflow; chosen.
# Largest time value, as a share of what is possible, that grows like a square next to the exercise region; calibrated.
ROOT_SHARE = 0.02
SMALLEST_START = 1e-6  # Smallest standard deviation of ln S at expiry to begin with; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Prices to meet, and what bounds them; every field has shape (n,), money per unit of underlying.

    Parameters
    ----------
    price : Vector
    bounds : PriceBounds
    spot, strike, expiry : Vector
    tolerance : Vector
        Fractions of the strike.
    """

    price: Vector
    bounds: PriceBounds
    spot: Vector
    strike: Vector
    expiry: Vector
    tolerance: Vector

    def take(self, rows: NDArray[np.intp]) -> Targets:
        """Return some of the targets."""
        columns = (self.price, self.spot, self.strike, self.expiry, self.tolerance)
        price, spot, strike, expiry, tolerance = (column[rows] for column in columns)
        return Targets(price, self.bounds.take(rows), spot, strike, expiry, tolerance)

    def share(self, rows: NDArray[np.intp], value: Vector) -> Vector:
        """Return the time value as a share of the largest that is possible."""
        return (value - self.bounds.lower[rows]) / self.span(rows)

    def span(self, rows: NDArray[np.intp]) -> Vector:
        """Return the largest time value that is possible."""
        return self.bounds.upper[rows] - self.bounds.lower[rows]


@dataclass(frozen=True, slots=True, eq=False)
class Coordinate:
    """A function y of the price, by row; every field has shape (n,).

    Parameters
    ----------
    moneyness : Vector
        |ln(F/K)| of the Black formula that has the option's bounds.
    is_root : bool array
        Whether y is the root of the share instead.
    """

    moneyness: Vector
    is_root: BoolVector

    def of(self, rows: NDArray[np.intp], share: Vector) -> tuple[Vector, Vector]:
        """Return y and its derivative by the share, for options `rows`."""
        y = black_spread(self.moneyness[rows], share)
        _, by_spread = black_time_value(self.moneyness[rows], y)
        root, is_root = np.sqrt(share), self.is_root[rows]
        return np.where(is_root, root, y), np.where(is_root, 0.5 / root, 1.0 / by_spread)


def choose_coordinate(targets: Targets) -> Coordinate:
    """Return the coordinate that is nearly straight around the targets.

    That is the spread at which Black's formula, with the option's bounds in the place of its own, gives the time
    value; for a European option it is sigma sqrt(T) itself. Next to the exercise region, where the time value grows
    like the square of what the volatility exceeds the smallest one at which holding pays, it is the root.
    """
    bounds = targets.bounds
    span = bounds.upper - bounds.lower
    inside = np.where(bounds.lower > 0.0, np.log(bounds.upper / span), bounds.out_of_the_money)
    is_root = bounds.at_once & (targets.price - bounds.lower < ROOT_SHARE * span)
    return Coordinate(np.clip(inside, 0.0, LARGEST_MONEYNESS), is_root)


def first_volatility(targets: Targets, coordinate: Coordinate, goal: Vector) -> Vector:
    """Return where the search begins: the coordinate itself as a spread, or that of the option as a European one.

    Next to the exercise region the second is taken, which is too large, but outside the region.
    """
    bounds = targets.bounds
    share = (targets.price - bounds.european_lower) / (bounds.european_upper - bounds.european_lower)
    european = black_spread(np.minimum(np.abs(bounds.out_of_the_money), LARGEST_MONEYNESS), share)
    spread = np.where(coordinate.is_root, european, goal)
    start: Vector = np.maximum(spread, SMALLEST_START) / np.sqrt(targets.expiry)
    return start
