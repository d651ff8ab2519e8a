"""Coulomb friction: what is stated of it, and polyhedral cones of directions in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from pricing_core.arrays import Matrix, Vector, as_real_array, as_vector, as_whole_number
from pricing_core.errors import InvalidInputError, Told

MOST_DIRECTIONS = 360  # of a contact
SPANNED = 1e-9  # share of the directions' lengths below which a sum of them is zero


def friction_directions(first: ArrayLike, second: ArrayLike, m: int) -> Matrix:
    """Return m directions at equal angles in the plane of two tangents, for `MechanicalSystem(tangents=...)`.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        first @ v and second @ v are the sliding velocity along two orthogonal unit vectors of the plane of contact.
    m : int
        From 3 to 360. The friction force along a direction between two of them is smaller than Coulomb's by up to
        the share 1 - cos(pi/m): 29 % for 4, 7.6 % for 8, 1.9 % for 16.

    Returns
    -------
    Matrix, shape (m, n)

    Examples
    --------
    >>> friction_directions([1, 0, 0], [0, 1, 0], 4).round(12) + 0.0
    array([[ 1.,  0.,  0.],
           [ 0.,  1.,  0.],
           [-1.,  0.,  0.],
           [ 0., -1.,  0.]])
    """
    along = as_vector("first", first)
    across = as_vector("second", second, along.size)
    angles = 2.0 * np.pi * np.arange(as_whole_number("m", m, 3, MOST_DIRECTIONS)) / m
    return np.asarray(np.outer(np.cos(angles), along) + np.outer(np.sin(angles), across))


def as_tangents(value: ArrayLike, k: int, n: int) -> NDArray[np.float64]:
    """Return tangents (k, n) or directions (k, m, n) that span planes, or raise InvalidInputError."""
    tangents = as_real_array("tangents", value)
    in_plane = tangents.shape == (k, n)
    if not in_plane and (tangents.ndim != 3 or tangents.shape[::2] != (k, n)):
        allowed = f"of shape ({k}, {n}) in the plane, or ({k}, m, {n}) with m directions in space"
        raise InvalidInputError("tangents", Told(f"shape {tangents.shape}"), allowed)
    if not in_plane:
        for i, directions in enumerate(tangents):
            _check_spanning(f"tangents[{i}]", directions)
    return tangents


def as_friction(value: ArrayLike, k: int) -> Vector:
    """Return k coefficients of friction, or raise InvalidInputError."""
    friction = as_vector("friction", value, k)
    if (friction < 0.0).any():
        raise InvalidInputError("friction", value, "coefficients >= 0")
    return friction


def _check_spanning(field: str, directions: Matrix) -> None:
    """Raise InvalidInputError unless a positive combination of the directions is zero: friction opposes any slip."""
    total = directions.sum(axis=0)
    size = float(np.abs(directions).sum())
    # c >= 0 with (1 + c) @ directions = 0.
    if len(directions) < 2 or nnls(directions.T, -total)[1] > SPANNED * size:
        raise InvalidInputError(
            field,
            directions.tolist(),
            "two or more directions of which a positive combination is zero, as friction_directions gives them",
        )
