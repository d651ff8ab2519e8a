"""Polynomials on an interval by their Bernstein coefficients, enclosed: signs that are proved, not sampled.

A polynomial lies between the smallest and the largest of its Bernstein coefficients; halving the interval (de
Casteljau) brings the bounds together. With coefficients in interval arithmetic a sign found this way is a proof.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.surface.interval import Interval, joined, stacked

DEEPEST = 40  # Largest number of times that an interval is halved; chosen.
MOST_PIECES = 200_000  # Largest number of pieces at work at once; chosen.


def product(a: Interval, b: Interval) -> Interval:
    """Return the coefficients of products of polynomials, (k, n + 1) and (k, m + 1) giving (k, n + m + 1)."""
    n, m = a.low.shape[1] - 1, b.low.shape[1] - 1
    left, right = a * _binomials(n), b * _binomials(m)
    total = Interval.exactly(np.zeros((a.low.shape[0], n + m + 1)))
    for i in range(n + 1):
        term = left[:, i : i + 1] * right
        padded = Interval(_placed(term.low, i, n + m + 1), _placed(term.high, i, n + m + 1))
        total = total + padded
    return total / _binomials(n + m)


def elevated(a: Interval, degree: int) -> Interval:
    """Return the coefficients of the same polynomials as ones of a higher degree."""
    extra = degree - (a.low.shape[1] - 1)
    return a if extra == 0 else product(a, Interval.exactly(np.ones((a.low.shape[0], extra + 1))))


def derivative(a: Interval, width: Interval) -> Interval:
    """Return the coefficients of the derivatives of polynomials on intervals of these widths, (k,)."""
    n = a.low.shape[1] - 1
    steps = (a[:, 1:] - a[:, :-1]) * Interval.exactly(float(n))
    return steps / Interval(width.low[:, None], width.high[:, None])


def positive(a: Interval) -> tuple[bool, Vector]:
    """Return whether all polynomials are proved to be above 0 on [0, 1], and where it is not proved.

    Returns
    -------
    bool
        True is a proof.
    Vector, shape (l,)
        Places among the pieces, index plus the share of the piece, at which a polynomial is not above 0 or the search
        gave up; empty where the proof stands.
    """
    pieces = np.arange(a.low.shape[0])
    start, width = np.zeros(pieces.size), 1.0
    failures: list[Vector] = []
    for _ in range(DEEPEST):
        at_start = a.high[:, 0] <= 0.0
        at_end = a.high[:, -1] <= 0.0
        failed = at_start | at_end
        failures.append((pieces + start + np.where(at_start, 0.0, width))[failed])
        left = ~failed & ~(a.low.min(axis=1) > 0.0)
        if not left.any():
            break
        a, pieces, start = a[left], pieces[left], start[left]
        width *= 0.5
        a = joined(list(_halves(a)))
        pieces, start = np.tile(pieces, 2), np.concatenate([start, start + width])
        if pieces.size > MOST_PIECES:
            failures.append(pieces + start)
            break
    else:
        failures.append(pieces + start)
    found = np.concatenate(failures)
    return found.size == 0, np.unique(found)


def spline_pieces(
    knots: Vector,
    coefficients: Matrix,
    degree: int,
    places: tuple[NDArray[np.intp], NDArray[np.intp]],
    ends: tuple[Interval, Interval],
) -> Interval:
    """Return the coefficients of splines on intervals, each within one span of the knots, shape (k, degree + 1).

    Coefficient j is the blossom of the left end, degree - j times, and the right end, j times (de Boor).

    Parameters
    ----------
    coefficients : Matrix, shape (m, n)
        Coefficients of m splines on the same knots.
    places : pair of int arrays, shape (k,)
        Which spline each interval belongs to, and the index of the knot at the left of its span.
    ends : pair of Interval, each of shape (k,)
        The ends of the intervals.
    """
    exact, c = Interval.exactly(knots), Interval.exactly(coefficients)
    rows, spans = places
    found = []
    for j in range(degree + 1):
        values = [c[rows, spans - degree + i] for i in range(degree + 1)]
        for r in range(1, degree + 1):
            place = ends[1] if r <= j else ends[0]
            for i in range(degree, r - 1, -1):
                low, high = exact[spans - degree + i], exact[spans + i + 1 - r]
                share = (place - low) / (high - low)
                values[i] = values[i - 1] + share * (values[i] - values[i - 1])
        found.append(values[degree])
    return stacked(found)


def _halves(a: Interval) -> tuple[Interval, Interval]:
    """Return the coefficients on both halves of the intervals."""
    half = Interval.exactly(0.5)
    row = [a[:, i] for i in range(a.low.shape[1])]
    left, right = [row[0]], [row[-1]]
    while len(row) > 1:
        row = [half * (one + two) for one, two in pairwise(row)]
        left.append(row[0])
        right.append(row[-1])
    return stacked(left), stacked(right[::-1])


def _binomials(n: int) -> Interval:
    return Interval.exactly(np.array([math.comb(n, i) for i in range(n + 1)], dtype=np.float64))


def _placed(values: NDArray[np.float64], at: int, length: int) -> NDArray[np.float64]:
    found = np.zeros((values.shape[0], length))
    found[:, at : at + values.shape[1]] = values
    return found
