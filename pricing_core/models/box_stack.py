"""Boxes on a plane and on each other, as a mechanical system with two contacts under each."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_number, as_vector
from pricing_core.errors import InvalidInputError
from pricing_core.models.friction import as_friction
from pricing_core.models.mechanics import MechanicalSystem


def box_stack(
    mass: ArrayLike,
    width: ArrayLike,
    height: ArrayLike,
    friction: ArrayLike,
    *,
    slope: float = 0.0,
    gravity: float = 9.81,
    restitution: float = 0.0,
) -> MechanicalSystem:
    """Return boxes that stand on each other in the plane, for small rotations and small slides.

    The coordinates are x_1, y_1, phi_1, x_2, ...: what each box has moved along the plane and away from it, in the
    units of its width, and its rotation in radians. All are 0 where the boxes stand on each other. Constraints 2 i and
    2 i + 1 are the lower left and the lower right corner of box i, on the plane for i = 0, else on the box below.

    Geometry is linear in the rotations, as the constraints F q >= 0 have to be. For a single box the work of gravity is
    of second order in the rotation, so that it rocks as Housner's slender block does (1963): phi'' = p^2 (phi - alpha),
    p^2 = m g h/(2 I), tan alpha = w/h, I the moment of inertia about the corner.

    Parameters
    ----------
    mass, width, height : array_like, shape (boxes,)
        > 0, from below. The boxes are homogeneous.
    friction : array_like, shape (boxes,)
        Coefficient at the contacts below each box.
    slope : float
        Angle of the plane in radians; x points downhill where it is > 0.
    gravity : float
    restitution : float

    Raises
    ------
    InvalidInputError
        No boxes, sizes that are not positive, a slope of pi/2 or more.

    Examples
    --------
    >>> stack = box_stack([1.0, 2.0], [1.0, 1.0], [0.5, 0.5], [0.4, 0.4])
    >>> stack.F.shape, (stack.F @ [0, 0.1, 0, 0, 0.1, 0]).round(12).tolist()
    ((4, 6), [0.1, 0.1, 0.0, 0.0])
    """
    masses = _positive("mass", mass)
    sizes = np.column_stack(
        [_positive("width", width, masses.size), _positive("height", height, masses.size)]
    )
    rough = np.repeat(as_friction(friction, masses.size), 2)
    angle, pull = as_number("slope", slope), as_number("gravity", gravity)
    if not abs(angle) < np.pi / 2.0:
        raise InvalidInputError("slope", slope, "between -pi/2 and pi/2")
    half_width, half_height = sizes.T / 2.0
    n = 3 * masses.size
    normals, tangents = np.zeros((2 * masses.size, n)), np.zeros((2 * masses.size, n))
    for box, (b, h) in enumerate(zip(half_width, half_height, strict=True)):
        for row, corner in ((2 * box, -b), (2 * box + 1, b)):
            own, below = slice(3 * box, 3 * box + 3), slice(3 * box - 3, 3 * box)
            normals[row, own], tangents[row, own] = (0.0, 1.0, corner), (1.0, 0.0, h)
            if box:
                normals[row, below] = (0.0, -1.0, -corner)
                tangents[row, below] = (-1.0, 0.0, half_height[box - 1])
    inertia = masses * (sizes**2).sum(axis=1) / 12.0
    weight = masses * pull
    stiffness = np.zeros((n, n))
    if masses.size == 1:
        stiffness[2, 2] = -weight[0] * np.cos(angle) * half_height[0]
    return MechanicalSystem(
        np.diag(np.column_stack([masses, masses, inertia]).ravel()),
        np.zeros((n, n)),
        stiffness,
        normals,
        np.column_stack([weight * np.sin(angle), -weight * np.cos(angle), 0.0 * weight]).ravel(),
        restitution=restitution,
        tangents=tangents,
        friction=rough,
    )


def _positive(field: str, value: ArrayLike, size: int | None = None) -> Vector:
    numbers = as_vector(field, value, size)
    if numbers.size == 0 or (numbers <= 0.0).any():
        raise InvalidInputError(field, value, "one or more numbers > 0")
    return numbers
