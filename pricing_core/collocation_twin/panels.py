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
    """Return the interval's panels, from its start each as wide as it may be."""
    smallest = SMALLEST_PANEL * fineness.spread
    done, a = [], start
    while a < stop:
        width, left = fineness.kernel * fineness.spread, stop - a
        for feature in features[-MOST_FEATURES:]:
            distance = feature.place - a
            share = fineness.feature / (1.0 + fineness.feature) if distance > 0.0 else fineness.feature
            width = min(width, max(share * abs(distance), fineness.feature * max(feature.scale, smallest)))
        # No crumb at the end.
        b = stop if left <= width else a + (0.5 * left if left < 2.0 * width else width)
        done.append((a, b))
        a = b
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
