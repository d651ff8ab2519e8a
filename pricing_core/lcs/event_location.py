"""The first time at which an output that must not be negative becomes negative, with no excursion missed.

Over one step every output is a Taylor polynomial in time, exact to rounding. In Bernstein form its least coefficient is
a lower bound of its values: where that is not negative nothing can have happened, and elsewhere the step is halved
until the bound or a value decides.
"""

import math
from collections.abc import Iterator
from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.mode_dynamics import DEGREE, POWERS

MOST_HALVINGS = 60
NEWTON_STEPS = 60
SAMPLES = 65
CLOSE = 1e-16
# Share of the step within which roots are one event.
SAME_TIME = 1e-13
FLAT = 1e3  # tolerances: an output that stays below is zero, and touches nothing


class Crossing(NamedTuple):
    """Where an output leaves the nonnegative numbers, in units of the step, and which outputs do so there."""

    place: float
    outputs: tuple[int, ...]


def first_crossing(
    polynomials: Matrix, end: float, tolerances: Vector, bounds: Matrix | None = None
) -> Crossing | None:
    """Return the first place in [0, end] behind which an output falls below minus its tolerance, None without one.

    Parameters
    ----------
    polynomials : Matrix, shape (DEGREE + 1, k)
        Coefficients, lowest power first.
    end : float
        At most 1.
    tolerances : Vector, shape (k,)
    bounds : Matrix, optional
        `bernstein` of the polynomials, where that is known.

    Notes
    -----
    An output that starts between zero and minus its tolerance and falls crosses at 0.

    Examples
    --------
    >>> line = np.zeros((DEGREE + 1, 1))
    >>> line[:2, 0] = 1.0, -4.0
    >>> first_crossing(line, 1.0, np.array([1e-12]))
    Crossing(place=0.25, outputs=(0,))
    """
    scaled = bernstein(polynomials, end) if bounds is None else bounds
    found: list[tuple[float, int]] = []
    for i in np.flatnonzero(scaled.min(axis=0) < -tolerances):
        bracket = _first_bracket(scaled[:, i], -float(tolerances[i]))
        if bracket is not None:
            found.append((_root_between(polynomials[:, i], bracket[0] * end, bracket[1] * end), int(i)))
    if not found:
        return None
    place = min(found)[0]
    return Crossing(place, tuple(sorted(i for root, i in found if root <= place + SAME_TIME)))


def bernstein(polynomials: Matrix, end: float) -> Matrix:
    """Return the Bernstein coefficients on [0, end], between whose least and largest each polynomial stays."""
    scaled = polynomials if end == 1.0 else polynomials * (end**POWERS)[:, None]
    return _bernstein() @ scaled


def touching_places(polynomials: Matrix, end: float, tolerances: Vector) -> list[float]:
    """Return where in (0, end) outputs touch zero, to within their tolerance, without crossing it."""
    scaled = polynomials * (end**POWERS)[:, None]
    bounds = _bernstein() @ scaled
    possible = (bounds.min(axis=0) <= tolerances) & (bounds.max(axis=0) > FLAT * tolerances)
    if not possible.any():
        return []
    samples = _samples() @ scaled
    turns = (samples[1:-1] <= samples[:-2]) & (samples[1:-1] <= samples[2:])
    found = []
    for i in np.flatnonzero(possible & turns.any(axis=0)):
        slope = np.polynomial.polynomial.polyder(np.trim_zeros(polynomials[:, i], "b"))
        roots = np.polynomial.polynomial.polyroots(slope) if slope.size > 1 else np.zeros(0)
        real = roots[np.abs(roots.imag) < 1e-6].real
        for place in real[(real > 1e-6 * end) & (real < (1.0 - 1e-6) * end)]:
            around = [max(place - 0.05 * end, 0.0), place, min(place + 0.05 * end, end)]
            before, value, after = np.polynomial.polynomial.polyval(around, polynomials[:, i])
            if abs(value) <= tolerances[i] and min(before, after) > FLAT * tolerances[i]:
                found.append(float(place))
    return sorted(found)


def _first_bracket(coefficients: Vector, level: float) -> tuple[float, float] | None:
    """Return the first interval in [0, 1] at whose ends the polynomial is positive and below the level.

    Where it falls below the level without having been positive, both ends are the place where it does.
    """
    waiting = [(0.0, 1.0, coefficients, 0)]
    while waiting:
        start, width, b, depth = waiting.pop()
        if b.min() >= level:
            continue
        if b[0] < level:
            return start, start
        above = b >= level
        single = np.count_nonzero(above[1:] != above[:-1]) == 1  # one sign change: one crossing
        if single and b[-1] < level and b[0] > 0.0:
            return start, start + width
        if depth == MOST_HALVINGS:
            if b[-1] < level:
                return start, start
            continue
        left, right = (half @ b for half in _halves())
        waiting += [
            (start + 0.5 * width, 0.5 * width, right, depth + 1),
            (start, 0.5 * width, left, depth + 1),
        ]
    return None


def _root_between(polynomial: Vector, low: float, high: float) -> float:
    """Return the zero between a place where the polynomial is positive and one where it is negative.

    Where both are one place, a positive value before it is looked for; without one the polynomial has fallen since 0.
    """
    coefficients = np.trim_zeros(polynomial, "b")[::-1].tolist()
    if low == high:
        rises = next((x for x in _places_before(high) if _value_and_slope(coefficients, x)[0] > 0.0), None)
        if rises is None:
            return 0.0
        low = rises
    place = high
    for _ in range(NEWTON_STEPS):
        value, slope = _value_and_slope(coefficients, place)
        low, high = (place, high) if value > 0.0 else (low, place)
        newton = place - value / slope if slope < 0.0 else math.nan
        following = newton if low < newton < high else 0.5 * (low + high)
        if value == 0.0 or abs(following - place) <= CLOSE * max(place, 1e-3):
            return place if value == 0.0 else following
        place = following
    return place


def _places_before(high: float) -> Iterator[float]:
    """Yield places in (0, high): ever farther from `high`, then ever nearer to 0, where bounces die out."""
    back = SAME_TIME
    while back < high:
        yield high - back
        back *= 2.0
    for _ in range(MOST_HALVINGS):
        high *= 0.5
        yield high


def _value_and_slope(coefficients: list[float], x: float) -> tuple[float, float]:
    """Evaluate a polynomial, highest power first, and its derivative."""
    value = slope = 0.0
    for coefficient in coefficients:
        slope = slope * x + value
        value = value * x + coefficient
    return value, slope


@cache
def _bernstein() -> Matrix:
    """Return the matrix that takes coefficients of powers to those of Bernstein polynomials on [0, 1]."""
    n = DEGREE
    return np.array([[comb(i, j) / comb(n, j) for j in range(n + 1)] for i in range(n + 1)])


@cache
def _samples() -> Matrix:
    """Return the matrix that takes coefficients of powers to values at places from 0 to 1."""
    return np.linspace(0.0, 1.0, SAMPLES)[:, None] ** np.arange(DEGREE + 1)


@cache
def _halves() -> tuple[Matrix, Matrix]:
    """Return the matrices that take Bernstein coefficients on [0, 1] to those on its halves (de Casteljau)."""
    n = DEGREE
    left = np.array([[comb(i, j) / 2.0**i for j in range(n + 1)] for i in range(n + 1)])
    return left, left[::-1, ::-1].copy()
