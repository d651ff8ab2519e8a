"""The inputs and outputs of a piecewise linear system on its characteristics, and the pieces that they are on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcs.flow import Flow
from pricing_core.linalg.subspaces import kernel
from pricing_core.models.characteristic import Characteristic
from pricing_core.models.nearest_point import nearest_point
from pricing_core.models.trajectory import ALONG, Pieces, sampled

MEETS = (
    1e-12  # share of the terms of an output, or of the corners' inputs, below which a distance is rounding
)
DEPENDENT = 1e-10  # largest singular value, of equilibrated columns, that counts as zero
ROUNDING = 64.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True, eq=False)
class OnCharacteristics:
    """(y_i, u_i) on characteristic i for y = Cx + Du, from the pairs w, z along the pieces of all characteristics.

    Along characteristic i with m points, (y_i, u_i) = point 0 - w_1 t_0 + z_1 t_1 + ... + z_m t_m with the tangents t;
    its piece j + 1 is entered where w_j = 0.
    """

    B: Matrix  # (n, k)
    C: Matrix  # (k, n)
    D: Matrix  # (k, k)
    characteristics: Sequence[Characteristic]

    @property
    def first_pairs(self) -> list[int]:
        """The first pair of each characteristic, and the number of all pairs p."""
        return [0, *itertools.accumulate(len(curve.points) for curve in self.characteristics)]

    def maps(self) -> tuple[Matrix, Matrix, Vector]:
        """Return the matrices (2 k, p), (2 k, p) and the vector (2 k,) that make (y, u) from w and z."""
        k, first = len(self.characteristics), self.first_pairs
        at_w, at_z, start = np.zeros((2 * k, first[-1])), np.zeros((2 * k, first[-1])), np.zeros(2 * k)
        for i, curve in enumerate(self.characteristics):
            rows = [i, k + i]
            start[rows] = curve.points[0]
            at_w[rows, first[i]] = -curve.tangents[0]
            at_z[rows, first[i] : first[i + 1]] = curve.tangents[1:].T
        return at_w, at_z, start

    def elements(self, x: Matrix, w: Matrix, z: Matrix) -> tuple[Matrix, Matrix]:
        """Return u and y, shapes (m, k), at m times.

        On a horizontal piece u is the constant that it is there, on a vertical one y. Where other u on vertical pieces
        make the same x' and the same y, u is the one of least Euclidean norm.
        """
        at_w, at_z, start = self.maps()
        k, entered = len(self.characteristics), z > w
        points = w @ at_w.T + z @ at_z.T + start
        y, u = points[:, :k], points[:, k:]
        first = self.first_pairs
        for i, curve in enumerate(self.characteristics):
            ends = _ends(curve)
            for piece in range(len(curve.tangents)):
                rows = entered[:, first[i] : first[i + 1]].sum(axis=1) == piece
                dy, du = curve.tangents[piece]
                corner, reach = curve.points[max(piece - 1, 0)], np.sort(ends[piece : piece + 2, 1])
                if dy == 0.0:
                    y[rows, i], u[rows, i] = corner[0], np.clip(u[rows, i], *reach)
                elif du == 0.0:
                    u[rows, i] = corner[1]
        return self._least(x, u, y), y

    def pieces(self, x: Matrix, u: Matrix, y: Matrix, count: int) -> NDArray[np.intp]:
        """Return the pieces on which the points stay, shape (m / count, k), for each `count` rows.

        Where they stay at a corner: the vertical piece there, else the one with the lower number.
        """
        found = np.empty((len(u) // count, u.shape[1]), dtype=np.intp)
        near_y, near_u = self._rounding(x, u)
        for i, curve in enumerate(self.characteristics):
            excess = np.stack(
                [
                    _excess(curve, j, u[:, i], y[:, i], near_u[i], near_y[i])
                    for j in range(len(curve.tangents))
                ],
                axis=1,
            )
            worst = excess.reshape(-1, count, excess.shape[1]).max(axis=1)
            stays = worst <= 1.0
            order = np.argsort(curve.tangents[:, 0] != 0.0, kind="stable")  # vertical pieces first
            first = order[np.argmax(stays[:, order], axis=1)]
            found[:, i] = np.where(stays.any(axis=1), first, worst.argmin(axis=1))
        return found

    def _rounding(self, x: Matrix, u: Matrix) -> tuple[Vector, Vector]:
        """Return the distances in y and in u that are rounding, each of shape (k,)."""
        corners = [np.abs(curve.points).max(axis=0) for curve in self.characteristics]
        largest = np.abs(u).max(axis=0, initial=0.0)
        terms = np.abs(self.C) @ np.abs(x).max(axis=0, initial=0.0) + np.abs(self.D) @ largest
        return (
            MEETS * np.array([size + corner[0] for size, corner in zip(terms, corners, strict=True)]),
            MEETS * np.array([size + corner[1] for size, corner in zip(largest, corners, strict=True)]),
        )

    def _least(self, x: Matrix, u: Matrix, y: Matrix) -> Matrix:
        """Return the inputs of least norm with the same B u and D u, each inside its vertical piece."""
        near_y, near_u = self._rounding(x, u)
        low, high = u.copy(), u.copy()
        for i, curve in enumerate(self.characteristics):
            for at, start, end in _vertical_parts(curve):
                inside = (np.abs(y[:, i] - at) <= near_y[i]) & (u[:, i] >= start - near_u[i])
                inside &= u[:, i] <= end + near_u[i]
                low[inside, i], high[inside, i] = start, end
        is_open = low < high
        least = u.copy()
        for pattern in np.unique(is_open, axis=0):
            directions = self._directions(pattern) if pattern.sum() else np.zeros((0, 0))
            if not directions.shape[1]:
                continue
            for row in np.flatnonzero((is_open == pattern).all(axis=1)):
                least[row, pattern] = _least_norm(
                    u[row, pattern], low[row, pattern], high[row, pattern], directions
                )
        return least

    def _directions(self, chosen: BoolVector) -> Matrix:
        """Return an orthonormal basis of the changes of the chosen inputs that B and D do not see, as columns."""
        seen = np.vstack([self.B[:, chosen], self.D[:, chosen]])
        sizes = np.abs(seen).max(axis=1, keepdims=True, initial=0.0)
        seen = seen / np.where(sizes > 0.0, sizes, 1.0)
        columns = np.abs(seen).max(axis=0, initial=0.0)
        columns = np.where(columns > 0.0, columns, 1.0)
        basis = np.asarray(np.linalg.qr(kernel(seen / columns, DEPENDENT) / columns[:, None])[0])
        basis[np.abs(basis) <= MEETS] = 0.0
        return basis


@dataclass(frozen=True, slots=True, eq=False)
class PairReading:
    """The run of a complementarity system of the pairs w, z, read in terms of the characteristics."""

    curves: OnCharacteristics
    pairs: Callable[[Matrix, Matrix], tuple[Matrix, Matrix]]  # from the system's u and y to w and z

    def external(self, x: Matrix, u: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
        """Return the inputs and outputs of the linear system."""
        return self.curves.elements(x, *self.pairs(u, y))

    def pieces(self, flows: tuple[Flow, ...]) -> list[Pieces]:
        """Return the pieces that the characteristics are on in each flow."""
        x, inputs, outputs = sampled(flows)
        u, y = self.external(x, inputs, outputs)
        return [tuple(row) for row in self.curves.pieces(x, u, y, ALONG.size).tolist()]


def _ends(curve: Characteristic) -> Matrix:
    """Return the points between which the pieces lie one after the other; vertical rays end at infinite u."""
    ends = curve.points[[0, *range(len(curve.points)), -1]].astype(np.float64)
    for end, side in ((0, -1.0), (-1, 1.0)):
        if curve.tangents[end, 0] == 0.0:
            ends[end, 1] += side * math.inf * curve.tangents[end, 1]
    return ends


def _vertical_parts(curve: Characteristic) -> list[tuple[float, float, float]]:
    """Return y and the least and greatest u of each vertical part, rays included."""
    ends, parts = _ends(curve), list[tuple[float, float, float]]()
    for j in np.flatnonzero(curve.tangents[:, 0] == 0.0).tolist():
        start, end = sorted(ends[j : j + 2, 1].tolist())
        if j and curve.tangents[j - 1, 0] == 0.0:
            _, before, after = parts.pop()
            start, end = min(start, before), max(end, after)
        parts.append((float(ends[j, 0]), start, end))
    return parts


def _least_norm(u: Vector, low: Vector, high: Vector, directions: Matrix) -> Vector:
    """Return u + directions t of least norm with low <= u <= high."""
    rows = np.vstack([directions, -directions])
    bounds = np.concatenate([low - u, u - high])
    limited = np.isfinite(bounds) & rows.any(axis=1)
    try:
        t = nearest_point(rows[limited], bounds[limited], -directions.T @ u).point
    except NumericalError:
        return u
    least = np.clip(u + directions @ t, low, high)
    least[np.abs(least) <= ROUNDING * np.abs(u).max()] = 0.0
    return np.asarray(least)


def _excess(curve: Characteristic, j: int, u: Vector, y: Vector, near_u: float, near_y: float) -> Vector:
    """Return how far the points are from piece j, as a multiple of what is rounding."""
    corner, (dy, du) = curve.points[max(j - 1, 0)], curve.tangents[j]
    length = curve.lengths[j - 1] if 0 < j < len(curve.points) else math.inf
    place = (y - corner[0]) / dy if dy else (u - corner[1]) / du
    inside = np.clip(place, -math.inf, 0.0) if j == 0 else np.clip(place, 0.0, length)
    away_y, away_u = np.abs(y - corner[0] - inside * dy), np.abs(u - corner[1] - inside * du)
    near_u += abs(dy * du) * near_y
    return np.asarray(np.maximum(away_y / max(near_y, 1e-300), away_u / max(near_u, 1e-300)))
