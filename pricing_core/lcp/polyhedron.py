"""Vertices and extreme rays of a face of {z >= 0, M z + q >= 0}."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from pricing_core.arrays import BoolVector, Matrix, Vector

RANK = 1e-10  # relative to the largest singular value
FEASIBLE = 1e-9  # for inequalities with rows of length 1


class Face(NamedTuple):
    """The polyhedron of all convex combinations of the vertices plus nonnegative combinations of the rays."""

    vertices: Matrix  # (k, n)
    rays: Matrix  # (m, n), the largest component of each is 1

    @property
    def is_point(self) -> bool:
        """Whether it is a single vertex."""
        return len(self.vertices) == 1 and len(self.rays) == 0


def face_of(M: Matrix, q: Vector, zero_z: BoolVector, zero_w: BoolVector) -> Face:
    """Return {z >= 0, w = M z + q >= 0, z_i = 0 where zero_z, w_i = 0 where zero_w} by its vertices and rays.

    Every index must be in one of the two sets, so that at most n inequalities are left, in coordinates of the
    affine hull. Cost: grows with the square of the number of vertices and rays.

    Examples
    --------
    >>> face_of(np.ones((2, 2)), -np.ones(2), np.array([False, False]), np.array([True, True]))
    Face(vertices=array([[0., 1.],
           [1., 0.]]), rays=array([], shape=(0, 2), dtype=float64))
    """
    base, directions = _affine_hull(M, q, zero_z, zero_w)
    free_z, free_w = ~zero_z, ~zero_w
    rows = np.vstack([directions[free_z], M[free_w] @ directions])
    offsets = np.concatenate([base[free_z], M[free_w] @ base + q[free_w]])
    homogeneous = _generators(np.column_stack([rows, offsets]))
    points = homogeneous[:, :-1] @ directions.T + homogeneous[:, -1:] * base
    points[:, zero_z] = 0.0
    at_infinity = homogeneous[:, -1] <= FEASIBLE
    return Face(
        _distinct(np.maximum(points[~at_infinity] / homogeneous[~at_infinity, -1:], 0.0)),
        _distinct(_largest_one(np.maximum(points[at_infinity], 0.0))),
    )


def _affine_hull(M: Matrix, q: Vector, zero_z: BoolVector, zero_w: BoolVector) -> tuple[Vector, Matrix]:
    """Return a point (n,) and an orthonormal basis of directions (n, d) of the equations."""
    equations = np.vstack([np.eye(q.size)[zero_z], M[zero_w]])
    values = np.concatenate([np.zeros(int(zero_z.sum())), -q[zero_w]])
    left, sizes, right = np.linalg.svd(equations)
    rank = int(np.sum(sizes > RANK * np.max(sizes, initial=0.0)))
    inverse = right[:rank].T / sizes[:rank] @ left[:, :rank].T
    point = inverse @ values
    point += inverse @ (values - equations @ point)
    return point, right[rank:].T


def _generators(inequalities: Matrix) -> Matrix:
    """Return every extreme ray (t, s) of {inequalities (t, s) >= 0, s >= 0}, shape (k, d + 1).

    The double description method of Motzkin: the rays of a simplicial cone, cut by one inequality at a time.
    """
    d = inequalities.shape[1] - 1
    rows = np.vstack([inequalities, np.append(np.zeros(d), 1.0)])
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > FEASIBLE] / lengths[lengths > FEASIBLE, None]
    _, _, order = qr(rows.T, mode="economic", pivoting=True)
    rows = rows[order]  # the first d + 1 are independent: where z >= 0 there is no whole line
    rays = _unit_length(np.linalg.inv(rows[: d + 1]).T)
    for k in range(d + 1, len(rows)):
        rays = _cut(rays, rows[:k], rows[k])
    return rays


def _cut(rays: Matrix, rows: Matrix, new_row: Vector) -> Matrix:
    """Return the extreme rays of {rows x >= 0, new_row x >= 0} from those of {rows x >= 0}."""
    heights = rays @ new_row
    tight = np.abs(rays @ rows.T) <= FEASIBLE
    sets = tight @ (1 << np.arange(len(rows)))  # the tight rows, at most n + 1, as a binary number
    above, below = np.flatnonzero(heights > FEASIBLE), np.flatnonzero(heights < -FEASIBLE)
    new = [rays[heights >= -FEASIBLE]]
    for i in above.tolist():
        # Two extreme rays span a face of dimension 2 iff no third one is tight wherever both are.
        candidates = below[(tight[below] & tight[i]).sum(axis=1) >= rays.shape[1] - 2]
        common = sets[candidates] & sets[i]
        holders = (common[:, None] & ~sets == 0).sum(axis=1)
        j = candidates[holders == 2]
        new.append(heights[i] * rays[j] - heights[j, None] * rays[i])
    return _unit_length(np.concatenate(new))


def _unit_length(rays: Matrix) -> Matrix:
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _largest_one(rays: Matrix) -> Matrix:
    return np.asarray(rays / np.max(rays, axis=1, keepdims=True, initial=1e-300))


def _distinct(points: Matrix) -> Matrix:
    """Clear the rounding off zeros, sort the rows, drop those that repeat another to within 1e-8."""
    smallest = FEASIBLE * (1.0 + np.max(points, axis=1, keepdims=True, initial=0.0))
    clean = np.where(points > smallest, points, 0.0)
    clean = clean[np.lexsort(clean.T[::-1])]
    repeats = [
        np.isclose(clean[:k], clean[k], rtol=1e-8, atol=1e-8).all(axis=1).any() for k in range(len(clean))
    ]
    return np.asarray(clean[~np.array(repeats, dtype=np.bool_)])
