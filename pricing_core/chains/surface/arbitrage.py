"""Proofs that smiles admit neither butterfly nor calendar arbitrage, wings included.

Butterfly: g(x) = (1 - x w'/(2 w))^2 - w'^2 (1/w + 1/4)/4 + w''/2 > 0 at all x (Durrleman), and slopes of the wings
below 2 (Lee 2004), so that d_+ falls to minus infinity. In units of theta and z = x/sqrt(theta), u = w/theta,

    4 u^2 g = (2 u - z u')^2 - u'^2 u - theta u'^2 u^2 / 4 + 2 u^2 u''

is a polynomial on every piece of the spline, and a quadratic on the straight wings. Calendar: the total variance of an
expiry lies above that of the one before, a polynomial on every common piece. Both signs are proved in interval
arithmetic, for the spline that the coefficients in floating-point numbers stand for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector
from pricing_core.chains.surface.bernstein import derivative, elevated, positive, product, spline_pieces
from pricing_core.chains.surface.interval import Interval, stacked
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smile_basis import DEGREE
from pricing_core.chains.surface.total_variance import TotalVariance

HIGHEST = 4 * DEGREE - 2  # Degree of u'^2 u^2.
NEXT_TO = 1e-6  # How far beyond an end of the knots a wing's failure is reported.


@dataclass(frozen=True, slots=True)
class NoArbitrage:
    """What is proved of the smiles, and where the proof fails.

    Parameters
    ----------
    butterfly : tuple of bool
        For each expiry: the density is above 0 everywhere, and the wings are admissible.
    calendar : tuple of bool
        For each expiry: its total variance lies above that of the expiry before (True for the first).
    butterfly_failures, calendar_failures : tuple of Vector
        Places x where that is not so, or not proved; empty where it is proved.
    """

    butterfly: tuple[bool, ...]
    calendar: tuple[bool, ...]
    butterfly_failures: tuple[Vector, ...]
    calendar_failures: tuple[Vector, ...]

    @property
    def holds(self) -> bool:
        """Whether all of it is proved."""
        return all(self.butterfly) and all(self.calendar)


def durrleman(x: Vector, w: Jet) -> Vector:
    """Return g(x) = (1 - x w'/(2 w))^2 - w'^2 (1/w + 1/4)/4 + w''/2."""
    lean = 1.0 - 0.5 * x * w.first / w.value
    found: Vector = lean * lean - 0.25 * w.first**2 * (1.0 / w.value + 0.25) + 0.5 * w.second
    return found


def prove(variance: TotalVariance) -> NoArbitrage:
    """Prove that the smiles of a surface admit no arbitrage, or say where that fails."""
    densities, orders = _butterfly(variance), _calendar(variance)
    return NoArbitrage(
        tuple(places.size == 0 for places in densities),
        tuple(places.size == 0 for places in orders),
        tuple(densities),
        tuple(orders),
    )


def _butterfly(variance: TotalVariance) -> list[Vector]:
    """Return, for each smile, the places x at which it is not proved to have a density."""
    basis, theta = variance.basis, variance.theta
    breaks, pieces = basis.breaks, basis.breaks.size - 1
    rows = np.repeat(np.arange(theta.size), pieces)
    spans = np.tile(np.arange(pieces), theta.size)
    left, right = Interval.exactly(breaks[spans]), Interval.exactly(breaks[spans + 1])
    u = spline_pieces(basis.knots, variance.coefficients, DEGREE, (rows, spans + DEGREE), (left, right))
    first = derivative(u, right - left)
    second = derivative(first, right - left)
    lean = elevated(u, DEGREE) * Interval.exactly(2.0) - product(stacked([left, right]), first)
    squared, flat = product(first, first), product(u, u)
    unit = Interval.exactly(theta[rows, None])
    density = (
        elevated(product(lean, lean), HIGHEST)
        - elevated(product(squared, u), HIGHEST)
        - product(squared, flat) * Interval.exactly(0.25) * unit
        + elevated(product(flat, second), HIGHEST) * Interval.exactly(2.0)
    )
    failures: list[list[float]] = [[] for _ in range(theta.size)]
    for polynomial in (density, u):
        for place in positive(polynomial)[1].tolist():
            piece = min(int(place), rows.size - 1)
            z = left.low[piece] + (place - piece) * (right.low[piece] - left.low[piece])
            failures[rows[piece]].append(math.sqrt(theta[rows[piece]]) * float(z))
    for i in range(theta.size):
        for side, piece, end in ((-1.0, i * pieces, 0), (1.0, (i + 1) * pieces - 1, -1)):
            if not _wing(u[piece, end], first[piece, end], float(breaks[end]), float(theta[i]), side):
                failures[i].append(math.sqrt(theta[i]) * float(breaks[end] + side * NEXT_TO))
    return [np.array(places) for places in failures]


def _wing(u: Interval, slope: Interval, end: float, theta: float, side: float) -> bool:
    """Return whether 4 u^2 g > 0 on the straight wing u + slope (z - end), and the slope is admissible.

    With y the distance from the end and b the slope outward it is c0 + c1 y + c2 y^2.
    """
    if side < 0.0:
        slope, end = -slope, -end
    unit, quarter = Interval.exactly(theta), Interval.exactly(0.25)
    lean = u * Interval.exactly(2.0) - slope * Interval.exactly(end)
    steep = slope.square()
    c0 = lean.square() - steep * (u + unit * quarter * u.square())
    c1 = lean * slope * Interval.exactly(2.0) - steep * slope * (
        Interval.exactly(1.0) + unit * u * Interval.exactly(0.5)
    )
    c2 = steep - steep.square() * unit * quarter
    # The slope of w by x is sqrt(theta) times that of u by z; c2 > 0 says that it lies below 2.
    if not (float(slope.low) >= 0.0 and float(u.low) > 0.0 and float(c0.low) > 0.0 and float(c2.low) > 0.0):
        return False
    bent = c0 * c2 * Interval.exactly(4.0) - c1.square()
    return float(c1.low) >= 0.0 or float(bent.low) > 0.0


def _calendar(variance: TotalVariance) -> list[Vector]:
    """Return, for each smile, the places x at which it is not proved to lie above the one before."""
    breaks, roots = variance.basis.breaks, np.sqrt(variance.theta)
    cuts = [
        np.unique(np.concatenate([breaks * roots[i - 1], breaks * roots[i]])) for i in range(1, roots.size)
    ]
    if not cuts:
        return [np.empty(0)]
    later = np.concatenate([np.full(own.size - 1, i + 1) for i, own in enumerate(cuts)])
    left, right = np.concatenate([own[:-1] for own in cuts]), np.concatenate([own[1:] for own in cuts])
    before, after = (_in_pieces(variance, rows, left, right) for rows in (later - 1, later))
    width = Interval.exactly(right) - Interval.exactly(left)
    steeper = derivative(after, width) - derivative(before, width)
    failures: list[list[float]] = [[] for _ in range(roots.size)]
    for place in positive(after - before)[1].tolist():
        piece = min(int(place), later.size - 1)
        failures[later[piece]].append(float(left[piece] + (place - piece) * (right[piece] - left[piece])))
    for i, own in enumerate(cuts, start=1):
        pieces = np.flatnonzero(later == i)
        if float(steeper.low[pieces[-1], -1]) < 0.0:
            failures[i].append(float(own[-1]) + NEXT_TO)
        if float(steeper.high[pieces[0], 0]) > 0.0:
            failures[i].append(float(own[0]) - NEXT_TO)
    return [np.array(places) for places in failures]


def _in_pieces(variance: TotalVariance, rows: NDArray[np.intp], left: Vector, right: Vector) -> Interval:
    """Return the coefficients of smiles on intervals in x, straight outside their breaks, shape (k, 6)."""
    basis, breaks = variance.basis, variance.basis.breaks
    root = np.sqrt(variance.theta)[rows]
    low, high = (Interval.exactly(end) / Interval.exactly(root) for end in (left, right))
    middle = 0.5 * (left + right) / root
    spans = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, breaks.size - 2)
    c = variance.coefficients
    inside = spline_pieces(basis.knots, c, DEGREE, (rows, spans + DEGREE), (low, high))
    least, most = inside.low.copy(), inside.high.copy()
    for end, span, beyond in ((0, 0, middle < breaks[0]), (-1, breaks.size - 2, middle > breaks[-1])):
        if beyond.any():
            line = _tangents(variance, rows[beyond], span, end, (low[beyond], high[beyond]))
            least[beyond], most[beyond] = line.low, line.high
    return Interval(least, most) * Interval.exactly(variance.theta[rows, None])


def _tangents(
    variance: TotalVariance, rows: NDArray[np.intp], span: int, end: int, ends: tuple[Interval, Interval]
) -> Interval:
    """Return the coefficients of straight wings on intervals, as polynomials of the splines' degree."""
    basis = variance.basis
    spans = np.full(rows.size, span)
    whole = Interval.exactly(basis.breaks[spans]), Interval.exactly(basis.breaks[spans + 1])
    u = spline_pieces(basis.knots, variance.coefficients, DEGREE, (rows, spans + DEGREE), whole)
    level, slope = u[:, end], derivative(u, whole[1] - whole[0])[:, end]
    place = Interval.exactly(basis.breaks[end])
    return elevated(stacked([level + slope * (part - place) for part in ends]), DEGREE)
