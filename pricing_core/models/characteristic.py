"""Piecewise linear characteristics: connected polylines in the (y, u) plane, vertical parts allowed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_extended_number, as_matrix, as_real_array
from pricing_core.errors import InvalidInputError, Told


@dataclass(frozen=True, slots=True, eq=False)
class Characteristic:
    """The graph (11.34c): a ray to the left, the polyline through the points in their order, a ray to the right.

    Piece 0 is the left ray, piece j leads from point j - 1 to point j, the last piece is the right ray.

    Parameters
    ----------
    points : sequence of (y, u)
        At least one. Equal y one after the other make a vertical part; y may also decrease, so that the curve
        folds back, but no piece may run back upon the piece before.
    left_slope, right_slope : float
        du/dy on the rays. Infinite slopes are vertical rays: the left one ends at y_0 coming from
        u = -inf for +inf, from u = +inf for -inf.

    Raises
    ------
    InvalidInputError
        No points, repeated points, pieces that run back, numbers that are not finite.

    Examples
    --------
    >>> step = Characteristic([(0, 1), (0, -1)])  # the relay u = -sgn y
    >>> step.tangents.tolist()
    [[1.0, 0.0], [0.0, -1.0], [1.0, 0.0]]
    """

    points: Matrix  # (m, 2): y, u
    left_slope: float
    right_slope: float

    def __init__(
        self,
        points: Sequence[tuple[float, float]] | ArrayLike,
        left_slope: float = 0.0,
        right_slope: float = 0.0,
    ) -> None:
        corners = as_matrix("points", points)
        if corners.shape[0] == 0 or corners.shape[1] != 2:
            raise InvalidInputError("points", Told(f"of shape {corners.shape}"), "one pair (y, u) or more")
        for name, slope in (("left_slope", left_slope), ("right_slope", right_slope)):
            object.__setattr__(self, name, as_extended_number(name, slope))
        object.__setattr__(self, "points", corners)
        for j in np.flatnonzero(~np.diff(corners, axis=0).any(axis=1)).tolist():
            raise InvalidInputError(
                f"points[{j + 1}]", tuple(corners[j + 1].tolist()), "another than the point before"
            )
        along = self.tangents
        for j, (one, other) in enumerate(itertools.pairwise(along)):
            if one[0] * other[1] == one[1] * other[0] and one @ other < 0.0:
                raise InvalidInputError(
                    f"points[{j}]",
                    tuple(corners[j].tolist()),
                    "a point where the curve does not run back on itself",
                )

    @property
    def lengths(self) -> Vector:
        """The change of y along each piece between points, or that of u where it is vertical, shape (m - 1,)."""
        steps = np.abs(np.diff(self.points, axis=0))
        return np.asarray(np.where(steps[:, 0] > 0.0, steps[:, 0], steps[:, 1]))

    @property
    def tangents(self) -> Matrix:
        """The directions of all pieces, from left to right, with unit change of y or of u, shape (m + 1, 2)."""
        between = np.diff(self.points, axis=0) / self.lengths[:, None]
        return np.vstack([_direction(self.left_slope), between, _direction(self.right_slope)])

    @property
    def is_function(self) -> bool:
        """Whether u is a function of y: y increases along the curve."""
        return bool((self.tangents[:, 0] > 0.0).all())

    def __call__(self, y: ArrayLike) -> Vector:
        """Return u at y, of the same shape.

        Raises
        ------
        InvalidInputError
            The curve has vertical parts, or parts on which y decreases.

        Examples
        --------
        >>> Characteristic([(-1, -1), (1, 1)])([-3.0, 0.5])
        array([-1. ,  0.5])
        """
        for j in np.flatnonzero(self.tangents[:, 0] <= 0.0).tolist():
            raise InvalidInputError(
                "points",
                Told(f"piece {j} with y not increasing"),
                "increasing in y where u is asked for by y",
            )
        given, (left, right) = as_real_array("y", y), (self.points[0], self.points[-1])
        inside = np.interp(given, self.points[:, 0], self.points[:, 1])
        below, above = np.minimum(given - left[0], 0.0), np.maximum(given - right[0], 0.0)
        return np.asarray(inside + self.left_slope * below + self.right_slope * above)

    def distance(self, y: ArrayLike, u: ArrayLike) -> Vector:
        """Return how far the points (y, u) are from the curve, in the shape of y and u.

        Examples
        --------
        >>> Characteristic([(-1, -1), (1, 1)]).distance([0.0, 2.0], [0.25, 1.5])
        array([0.1767767, 0.5      ])
        """
        at, through = as_real_array("y", y), as_real_array("u", u)
        if at.ndim and through.ndim and at.shape != through.shape:
            raise InvalidInputError("u", Told(f"of shape {through.shape}"), f"of the shape of y, {at.shape}")
        places = np.stack(np.broadcast_arrays(at, through), axis=-1)
        along = self.tangents / np.linalg.norm(self.tangents, axis=1, keepdims=True)
        starts = np.vstack([self.points[:1], self.points])
        reach = np.concatenate([[np.inf], np.linalg.norm(np.diff(self.points, axis=0), axis=1), [np.inf]])
        along[0] *= -1.0
        best = np.full(places.shape[:-1], np.inf)
        for start, direction, length in zip(starts, along, reach, strict=True):
            place = np.clip((places - start) @ direction, 0.0, length)
            best = np.minimum(best, np.linalg.norm(places - start - place[..., None] * direction, axis=-1))
        return best


def _direction(slope: float) -> Vector:
    """Return the direction in which a ray of this slope runs from left to right."""
    return np.array([0.0, math.copysign(1.0, slope)] if math.isinf(slope) else [1.0, slope])
