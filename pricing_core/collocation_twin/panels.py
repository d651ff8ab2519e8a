"""Gauss panels on an interval of x, fine where the value is not smooth."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from pricing_core.arrays import Vector

MOST_FEATURES = 12
SMALLEST_PANEL = 0.04  # spreads of the stretch


class Feature(NamedTuple):
    """A place where the value bends within `scale`."""

    place: float
    scale: float


class Fineness(NamedTuple):
    """How wide panels may be.

    Parameters
    ----------
    spread : float
        sigma sqrt(h) of the stretch before.
    points : int
        Gauss points of a panel.
    kernel : float
        Widest panel, in spreads.
    feature : float
        Widest panel, in distances to a feature.
    """

    spread: float
    points: int
    kernel: float
    feature: float


def panels(
    start: float, stop: float, features: tuple[Feature, ...], fineness: Fineness
) -> list[tuple[float, float]]:
    """Return the interval's panels, halved until each is narrow enough."""
    smallest = SMALLEST_PANEL * fineness.spread
    waiting, done = [(start, stop)], []
    while waiting:
        a, b = waiting.pop()
        allowed = fineness.kernel * fineness.spread
        for feature in features[-MOST_FEATURES:]:
            distance = max(a - feature.place, feature.place - b, 0.0)
            allowed = min(allowed, fineness.feature * max(feature.scale, distance, smallest))
        if b - a > allowed:
            middle = 0.5 * (a + b)
            waiting += [(middle, b), (a, middle)]
        else:
            done.append((a, b))
    return done


def gauss_nodes(cuts: list[tuple[float, float]], points: int) -> tuple[Vector, Vector]:
    """Return the nodes of all panels and their weights."""
    if not cuts:
        return np.zeros(0), np.zeros(0)
    ends = np.array(cuts)
    places, weights = leggauss(points)
    half = 0.5 * (ends[:, 1] - ends[:, 0])[:, None]
    middle = 0.5 * (ends[:, 1] + ends[:, 0])[:, None]
    return (middle + half * places).ravel(), (half * weights).ravel()
