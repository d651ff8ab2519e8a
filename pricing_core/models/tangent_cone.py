"""The cone of admissible velocities {v | H v >= 0}, H the gradients of the active constraints (11.43)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.nearest_point import nearest_direction

VANISHES = 1e-12  # Share of |v| below which a correction is rounding.


class ProjectedVelocity(NamedTuple):
    """The vector v of the cone that is nearest to v0, and the multipliers u with v = v0 + H^T u."""

    v: Vector  # (n,)
    u: Vector  # (k,)


def project_velocity(H: Matrix, v0: Vector) -> ProjectedVelocity:
    """Project v0 on {v | H v >= 0} by 0 <= H v0 + H H^T u _|_ u >= 0 (11.43); the minimiser is v0 + H^T u.

    Parameters
    ----------
    H : Matrix, shape (k, n)
        Rows that depend on each other are allowed: v is then unique, u one of many.
    v0 : Vector, shape (n,)

    Examples
    --------
    >>> project_velocity(np.eye(2), np.array([3.0, -2.0]))
    ProjectedVelocity(v=array([3., 0.]), u=array([0., 2.]))
    """
    return ProjectedVelocity(*nearest_direction(H, v0))


def steepest_normal(H: Matrix, v0: Vector) -> Vector | None:
    """Return the inward normal gamma* = H^T u / |H^T u|, u >= 0, for which <v0, -gamma> is largest (11.42).

    With it the projection is v0 + max(0, <v0, -gamma*>) gamma* (11.41).

    Returns
    -------
    Vector, shape (n,), or None
        None where v0 is in the cone: every normal then has <v0, -gamma> <= 0.

    Examples
    --------
    >>> steepest_normal(np.eye(2), np.array([-3.0, -4.0]))
    array([0.6, 0.8])
    """
    normal = project_velocity(H, v0).v - v0
    size = float(np.linalg.norm(normal))
    return normal / size if size > VANISHES * float(np.linalg.norm(v0)) else None
