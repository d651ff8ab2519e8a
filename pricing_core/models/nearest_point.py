"""The nearest point of a polyhedron by nonnegative least squares, which end however many constraints meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp import LCP, solve

STEPS_PER_CONSTRAINT = 30
SUPPORTS = 1e-14  # share of the largest multiplier from which on a constraint is taken to hold the point
ACCEPTED = 1e-9  # the same of the complementarity problem
NOT_FOUND = "no point that satisfies all constraints was found: they contradict each other, or nearly do"
EPS = 4.0 * np.finfo(np.float64).eps  # the rounding of a product
ROUNDS = 8.0  # of these by which constraints are loosened where they leave no point, besides
ROUNDED = 1e-13  # share of the distances by which constraints are loosened where they leave no point
VIOLATED = 1e-12  # share of the distances below which a violation is rounding


class NearestPoint(NamedTuple):
    """The point, and multipliers u >= 0 with point = x + H^T u; they are not unique where rows depend on each other."""

    point: Vector  # (n,)
    u: Vector  # (k,)


def nearest_point(H: Matrix, h: Vector, x: Vector) -> NearestPoint:
    """Minimise |z - x| subject to H z >= h.

    The distance programme with the rows at unit length, as one problem of nonnegative least squares in the
    multipliers; the point is then put on the constraints that support it, by least squares again. Where that violates
    another, as it may where they leave a single point, all constraints are loosened by 1e-13 of the distances, and
    then the complementarity problem in H H^T is solved.

    Raises
    ------
    NumericalError
        Neither gave a point within rounding of the constraints.

    Notes
    -----
    Source: Lawson and Hanson, Solving Least Squares Problems, chapter 23 (problem LDP).

    Examples
    --------
    >>> nearest_point(np.eye(2), np.zeros(2), np.array([3.0, -2.0]))
    NearestPoint(point=array([3., 0.]), u=array([0., 2.]))
    """
    lengths = np.linalg.norm(H, axis=1)
    rows = lengths > 0.0
    G = H[rows] / lengths[rows, None]
    gap = h[rows] / lengths[rows] - G @ x
    u = np.zeros(h.size)
    size = float(gap.max(initial=0.0))
    rounding = EPS * (np.abs(h[rows]) / lengths[rows] + np.abs(G) @ np.abs(x))
    loosening = ROUNDS * rounding + ROUNDED * (size + float(np.abs(gap).max(initial=0.0)))
    for left in (gap, gap - loosening):
        if not (left > rounding).any():
            return NearestPoint(x, u)
        shift = _least_distance(G, left / size)
        if shift is not None:
            break
    else:
        return _by_complementarity(H, h, x)
    move, weights = shift
    u[rows] = size * weights / lengths[rows]
    return NearestPoint(x + size * move, u)


def nearest_direction(H: Matrix, v0: Vector) -> NearestPoint:
    """Minimise |v - v0| subject to H v >= 0, a cone: u minimises |v0 + H^T u| over u >= 0.

    Examples
    --------
    >>> nearest_direction(np.ones((3, 1)), np.array([-2.0])).point
    array([0.])
    """
    lengths = np.linalg.norm(H, axis=1)
    rows = lengths > 0.0
    size = float(np.linalg.norm(v0))
    u = np.zeros(len(H))
    if size == 0.0 or not (H @ v0 < 0.0).any():
        return NearestPoint(v0, u)
    G, direction = H[rows] / lengths[rows, None], v0 / size
    weights = _nonnegative(G.T, -direction)
    if weights is None:
        return _by_complementarity(H, np.zeros(len(H)), v0)
    held = _supporting(weights)
    u[rows] = size * weights / lengths[rows]
    return NearestPoint(size * (direction + np.linalg.lstsq(G[held], -G[held] @ direction)[0]), u)


def _least_distance(G: Matrix, gap: Vector) -> NearestPoint | None:
    """Return the shortest y with G y >= gap and its multipliers; None where they miss the constraints."""
    last = np.zeros(G.shape[1] + 1)
    last[-1] = 1.0
    weights = _nonnegative(np.vstack([G.T, gap]), last)
    if weights is None:
        return None
    scale = 1.0 - float(gap @ weights)
    if scale <= 0.0:
        return None
    held = _supporting(weights)
    if not held.any():
        return None
    u = weights / scale
    y = np.asarray(np.linalg.lstsq(G[held], gap[held])[0], dtype=np.float64)
    reach = 1.0 + float(np.abs(y).max(initial=0.0)) + float(np.abs(gap).max(initial=0.0))
    if (G @ y < gap - VIOLATED * reach).any():
        return None
    return NearestPoint(y, u)


def _nonnegative(matrix: Matrix, vector: Vector) -> Vector | None:
    """Return the w >= 0 for which |matrix w - vector| is least; None where the iteration ends before."""
    try:
        return np.asarray(nnls(matrix, vector, maxiter=STEPS_PER_CONSTRAINT * (matrix.shape[1] + 1))[0])
    except RuntimeError:
        return None


def _supporting(weights: Vector) -> BoolVector:
    held: BoolVector = weights > SUPPORTS * float(weights.max(initial=0.0))
    return held


def _by_complementarity(H: Matrix, h: Vector, x: Vector) -> NearestPoint:
    """Solve 0 <= H x - h + H H^T u _|_ u >= 0."""
    try:
        u = solve(LCP(H @ H.T, H @ x - h)).z
    except NumericalError:  # of rounded products: it proves nothing of H and h
        raise NumericalError(NOT_FOUND) from None
    point = x + H.T @ u
    reach = 1.0 + float(np.abs(point).max(initial=0.0)) + float(np.abs(x).max(initial=0.0))
    if (H @ point < h - ACCEPTED * (reach * np.abs(H).sum(axis=1) + np.abs(h))).any():
        raise NumericalError(NOT_FOUND)
    return NearestPoint(point, u)
