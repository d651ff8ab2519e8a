"""The local volatility under which European options cost what the surface says, by Dupire's formula."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import Vector
from pricing_core.chains.surface.arbitrage import durrleman
from pricing_core.chains.surface.coordinates import Coordinates
from pricing_core.chains.surface.implied_surface import COMPLEX_STEP, ImpliedSurface
from pricing_core.chains.surface.jet import Jet
from pricing_core.errors import InvalidInputError

BETWEEN = 3  # Number of nodes in time between two expiries, and before the first; chosen.
SIDE_OF_JUMP = (
    1e-6  # How long before a jump of the local volatility the node before it is, as a share; chosen.
)
REACH = 5.0  # Beyond so many standard deviations the local volatility stays what it is there; chosen.
FINEST, STEP = 2.0, 0.06  # Nodes in ln S at FINEST sqrt(theta_1) sinh(STEP j) from the spot; chosen.
# Between which multiples of the volatility at the money the local volatility of X is held, and the least g; chosen.
LEAST_MULTIPLE, MOST_MULTIPLE, LEAST_DENSITY = 0.1, 6.0, 1e-3
LEAST_SHARE = 0.05  # Smallest (S - D)/S, which no spot reaches that the surface gives a probability to.


def dupire(surface: ImpliedSurface, market: Market) -> LocalVolatility:
    """Return the local volatility of the spot on nodes, bounded everywhere.

    For the martingale X, with w its total variance at x = ln X and g Durrleman's function, sigma_X^2 = w_T/g (Dupire
    1994; Gatheral 2006); the spot S = (F - D) X + D has sigma_X (S - D)/S. Nodes lie at the expiries and three times
    in between, on both sides of every dividend, and in ln S about 0.12 standard deviations of the first expiry apart at
    the spot and further away from each other outside.

    Parameters
    ----------
    surface : ImpliedSurface
    market : Market
        Its spot, carry and dividends map the surface's coordinate to the spot.
    """
    coordinates = Coordinates(market, float(surface.expiries[-1]))
    times, spots = node_times(surface, coordinates), node_spots(surface, market.spot)
    rows = [spot_volatility(surface, coordinates, spots, time) for time in times.tolist()]
    return LocalVolatility(times, spots, np.array(rows))


def spot_volatility(surface: ImpliedSurface, coordinates: Coordinates, spots: Vector, time: float) -> Vector:
    """Return the local volatility of the spot at a time after 0 and at spots, money, shape (k,)."""
    due = coordinates.due(time)
    x = _clipped(surface, coordinates, spots, time)
    at_money = surface.variance.at(np.zeros(1), time)[0].value[0] / time
    jet, by_time = surface.variance.at(x, time)
    density = np.maximum(durrleman(x, jet), LEAST_DENSITY)
    limits = at_money * np.array([LEAST_MULTIPLE, MOST_MULTIPLE]) ** 2
    own = np.sqrt(np.clip(by_time / density, *limits))
    return np.asarray(own * np.maximum(1.0 - due / spots, LEAST_SHARE))


def local_volatility_error(surface: ImpliedSurface, market: Market, spots: ArrayLike, time: float) -> Vector:
    """Return the standard errors of the local volatility at a time, years, and at spots, money, shape (k,).

    Raises
    ------
    InvalidInputError
        The time is not above 0.
    """
    if not (math.isfinite(time) and time > 0.0):
        raise InvalidInputError("time", time, "a number of years above 0")
    coordinates = Coordinates(market, float(surface.expiries[-1]))
    places = np.asarray(spots, dtype=np.float64).ravel()
    x = _clipped(surface, coordinates, places, time)
    smiles = surface.variance.smiles(x)
    terms = []
    for i, smile in enumerate(smiles):
        for order, unit in enumerate(
            (smile.value, np.full_like(x, surface.variance.theta[i] ** 0.5), np.ones_like(x))
        ):
            step = COMPLEX_STEP * unit
            parts = [smile.value, smile.first, smile.second]
            parts[order] = parts[order] + 1j * step
            moved = [*smiles[:i], Jet(*parts), *smiles[i + 1 :]]
            jet, by_time = surface.variance.between(moved, x, time)
            changed = np.imag(by_time / durrleman(x, jet)) / step
            if changed.any():
                terms.append((i, order, changed))
    variance = surface.spread(x, terms)
    share = np.maximum(1.0 - coordinates.due(time) / places, LEAST_SHARE)
    jet, by_time = surface.variance.at(x, time)
    own = np.sqrt(np.maximum(by_time / np.maximum(durrleman(x, jet), LEAST_DENSITY), 1e-12))
    return np.asarray(0.5 * variance / own * share)


def node_times(surface: ImpliedSurface, coordinates: Coordinates) -> Vector:
    """Return the nodes in time: expiries, times in between, and both sides of what jumps."""
    expiries = surface.expiries
    first = float(expiries[0])
    inside = [first * share for share in (1e-3, 0.25, 0.5, 0.75, 1.0 - SIDE_OF_JUMP)]
    for early, late in zip(expiries.tolist(), expiries[1:].tolist(), strict=False):
        inside += (early * (late / early) ** (np.arange(1, BETWEEN + 1) / (BETWEEN + 1))).tolist()
    jumps = [
        time
        for time in coordinates.breaks(float(expiries[-1]))
        if coordinates.due(time * (1.0 - 1e-12)) > 0.0
    ]
    before = [time * (1.0 - SIDE_OF_JUMP) for time in jumps]
    return np.unique(np.array([*expiries.tolist(), *inside, *jumps, *before]))


def node_spots(surface: ImpliedSurface, spot: float) -> Vector:
    """Return the nodes in the spot, money: dense at the spot, wide enough for the last expiry."""
    roots = np.sqrt(surface.variance.theta[[0, -1]])
    width = FINEST * float(roots[0])
    count = math.ceil(math.asinh((REACH + 1.0) * float(roots[1]) / width) / STEP)
    return np.asarray(spot * np.exp(width * np.sinh(STEP * np.arange(-count, count + 1))))


def _clipped(surface: ImpliedSurface, coordinates: Coordinates, spots: Vector, time: float) -> Vector:
    """Return the coordinates of spots, held to what is likely at a time."""
    x = coordinates.x(spots, time)
    most = REACH * math.sqrt(float(surface.variance.at(np.zeros(1), time)[0].value[0]))
    return np.asarray(np.clip(x, -most, most))
