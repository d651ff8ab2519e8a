"""The kernel's functions that follow a mode of a complementarity system, in NumPy: their replacement and their test.

Over one step every output is a Taylor polynomial in time, exact to rounding. In Bernstein form its least coefficient is
a lower bound of its values: where that is not negative nothing can have happened, and elsewhere the step is halved
until the bound or a value decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from math import comb
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector

Table: TypeAlias = NDArray[np.float64]

DEGREE = 26
POWERS = np.arange(DEGREE + 1)
MOST_HALVINGS = 60
NEWTON_STEPS = 60
SAMPLES = 65
CLOSE = 1e-16
SAME_TIME = 1e-13  # share of the step within which roots are one event
LEAST_SIZE = 1e-290  # of the terms of an output
FLAT = 1e3  # tolerances: an output that stays below is zero, and touches nothing
LOW = 64.0 * float(np.finfo(float).eps)  # of an output's size: how far above zero is rounding
SLOW = 1e-9  # share of its terms below which the slope of an output is rounding or tangency
FLIGHT = np.array([0.25, 0.5, 0.75])  # shares of the way at which the height of a flight is looked at
ROUNDING = 1e-13  # share of its terms below which a sum is rounding


def taylor_step(
    rate: Matrix, outputs: Matrix, c: Vector, sizes: Vector, reach: float, share: float
) -> tuple[float, list[int], Vector, Vector, bool, bool, bool]:
    """Follow c' = R c with C c >= 0 over `reach` <= 1 units of time, or up to where an output becomes negative.

    Parameters
    ----------
    rate : Matrix, shape (d, d)
        R, in a unit of time within which the Taylor series has converged.
    outputs : Matrix, shape (k, d)
        C.
    c, sizes : Vector, shape (d,)
        The coordinates, and the sizes of their terms.
    reach, share : float
        An output is negative below minus `share` of its terms' sizes, as they are at the start or larger on the way.

    Returns
    -------
    place : float
        The place of the first crossing, or `reach`. An output that starts between zero and minus its tolerance and
        falls crosses at 0.
    crossed : list of int
    c, sizes : Vector, shape (d,)
        At the place.
    flat, slow : bool
        Whether what crosses had not risen by more than rounding; whether it crosses with next to no slope.
    may_touch : bool
        Whether an output may have touched zero on the way without crossing it.

    Examples
    --------
    >>> one = np.array([1.0, 1.0])
    >>> taylor_step(np.array([[0.0, -4.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), one, one, 1.0, 1e-11)[:2]
    (0.25, [0])
    """
    terms = np.zeros((DEGREE + 1, c.size))
    terms[0] = c
    with np.errstate(over="ignore", invalid="ignore"):
        for j in range(DEGREE):
            terms[j + 1] = rate @ terms[j] / (j + 1)
            if not terms[j + 1].any():
                break
        swept, ahead = (np.asarray(reach**POWERS @ part) for part in (np.abs(terms), terms))
    if not np.isfinite(swept).all():
        return reach, [], ahead, swept, False, False, False
    polynomials = terms @ outputs.T
    tolerances = share * np.maximum(np.abs(outputs) @ np.maximum(sizes, swept), LEAST_SIZE)
    bounds = _bernstein() @ (polynomials * (reach**POWERS)[:, None])
    least = bounds.min(axis=0)
    if (least > tolerances).all():
        return reach, [], ahead, swept, False, False, False
    place, crossed = _first_crossing(polynomials, reach, tolerances, bounds)
    powers = place**POWERS
    end, sizes = np.asarray(powers @ terms), np.asarray(powers @ np.abs(terms))
    flat = slow = False
    if crossed:
        heights = (place * FLIGHT)[:, None] ** POWERS @ polynomials[:, crossed]
        flat = bool((heights <= LOW * (np.abs(outputs[crossed]) @ sizes)).all())
        slopes = outputs[crossed] @ rate
        slow = bool((np.abs(slopes @ end) <= SLOW * (np.abs(slopes) @ sizes)).all())
    return place, crossed, end, sizes, flat, slow, _may_touch(polynomials, place, tolerances)


def enter_mode(matrix: Matrix, z: Vector, sizes: Vector) -> tuple[Vector, Vector]:
    """Return W z, zero where that is no more than rounding, and |W| sizes; W is (d, N).

    Examples
    --------
    >>> enter_mode(np.array([[1.0, -1.0]]), np.array([0.1 + 0.2, 0.3]), np.array([1.0, 3.0]))
    (array([0.]), array([4.]))
    """
    found, absolute = matrix @ z, np.abs(matrix)
    return np.where(np.abs(found) <= ROUNDING * (absolute @ np.abs(z)), 0.0, found), absolute @ sizes


def initial_signs(
    derivatives: Table, rate: Matrix, c: Vector, sizes: Vector, value_share: float, derivative_share: float
) -> Vector:
    """Return each output's sign just after the coordinates are c, (k,): of its first derivative that is not zero.

    Parameters
    ----------
    derivatives : array, shape (orders, k, d)
        The outputs as functions of c, and their first derivatives.
    rate : Matrix, shape (d, d)
        c' as a function of c, in the same unit of time.
    sizes : Vector, shape (d,)
        Sizes of the terms of c.
    value_share, derivative_share : float
        Shares of its terms' sizes below which an output, and a derivative, is zero: what is tangential leaves a slope
        of the order of the root of rounding.

    Examples
    --------
    >>> fall = np.array([[0.0, 1.0], [0.0, 0.0]])
    >>> initial_signs(np.array([[[1.0, 0.0]]]), fall, np.array([0.0, -2.0]), np.ones(2), 1e-11, 1e-9)
    array([-1.])
    """
    orders, (k, d) = len(derivatives), derivatives[0].shape
    signs, vector, terms = np.zeros(k), c, sizes
    outputs = derivatives[0]
    for order in range(max(d + 1, orders)):
        rows = derivatives[order] if order < orders else outputs
        values = rows @ (c if order < orders else vector)
        if order == 0:
            least = value_share * (np.abs(rows) @ sizes)
        else:
            rounding = min(ROUNDING, derivative_share) * (np.abs(outputs) @ terms)
            least = np.maximum(derivative_share * (np.abs(rows) @ sizes), rounding)
        signs = np.where(signs == 0.0, np.where(np.abs(values) > least, np.sign(values), 0.0), signs)
        if signs.all():
            break
        vector, terms = rate @ vector, np.abs(rate) @ terms
        if order + 1 >= orders and not vector.any():
            break
    return signs


def leading_signs(impulses: Table, z: Vector, sizes: Vector, share: float) -> Vector:
    """Return each output's sign of its leading impulse, 0 without one, (k,).

    Parameters
    ----------
    impulses : array, shape (r, k, N)
        The coefficients of the derivatives of delta as functions of z, the highest first.
    sizes : Vector, shape (N,)
        Sizes of the terms of z; `share` of these is no impulse.

    Examples
    --------
    >>> leading_signs(np.array([[[0.0], [2.0]], [[-1.0], [-1.0]]]), np.ones(1), np.ones(1), 1e-11)
    array([-1.,  1.])
    """
    values = impulses @ z
    signs = np.zeros(impulses.shape[1])
    for found, least in zip(values, share * (np.abs(impulses) @ sizes), strict=True):
        signs = np.where(signs == 0.0, np.where(np.abs(found) > least, np.sign(found), 0.0), signs)
    return signs


def _first_crossing(
    polynomials: Matrix, end: float, tolerances: Vector, bounds: Matrix
) -> tuple[float, list[int]]:
    """Return the first place in [0, end] behind which outputs fall below minus their tolerance, and these."""
    found: list[tuple[float, int]] = []
    for i in np.flatnonzero(bounds.min(axis=0) < -tolerances):
        bracket = _first_bracket(bounds[:, i], -float(tolerances[i]))
        if bracket is not None:
            found.append((_root_between(polynomials[:, i], bracket[0] * end, bracket[1] * end), int(i)))
    if not found:
        return end, []
    place = min(found)[0]
    return place, sorted(i for root, i in found if root <= place + SAME_TIME)


def _may_touch(polynomials: Matrix, end: float, tolerances: Vector) -> bool:
    """Tell whether an output may come to within its tolerance of zero in (0, end) and turn back."""
    scaled = polynomials * (end**POWERS)[:, None]
    bounds = _bernstein() @ scaled
    possible = (bounds.min(axis=0) <= tolerances) & (bounds.max(axis=0) > FLAT * tolerances)
    if not possible.any():
        return False
    samples = _samples() @ scaled[:, possible]
    return bool(((samples[1:-1] <= samples[:-2]) & (samples[1:-1] <= samples[2:])).any())


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
    return np.linspace(0.0, 1.0, SAMPLES)[:, None] ** POWERS


@cache
def _halves() -> tuple[Matrix, Matrix]:
    """Return the matrices that take Bernstein coefficients on [0, 1] to those on its halves (de Casteljau)."""
    n = DEGREE
    left = np.array([[comb(i, j) / 2.0**i for j in range(n + 1)] for i in range(n + 1)])
    return left, left[::-1, ::-1].copy()
