"""Prescribed meshes of time to expiry: uniform ones, and those that are finer near expiry."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from pricing_core.american.book.resolution import TimeMesh
from pricing_core.arrays import Vector

# The power p of tau_k = T (k/M)**p; adaptive steps take no more than its first steps from a mesh.
POWERS: dict[TimeMesh, int] = {"uniform": 1, "square-root": 2, "cube-root": 3, "adaptive": 2}
# Smallest step, as a share of the duration, after which the exercise region can be told from rounding; chosen.
SMALLEST_STEP = 1e-9


def prescribed_mesh(kind: TimeMesh, duration: float, steps: int, stop_times: Iterable[float] = ()) -> Vector:
    """Return the mesh of times from 0 to the duration, shape (m + 1,), with further times at which a step must end.

    Parameters
    ----------
    stop_times : iterable of float
        Above 0; a time of the mesh that lies next to one of them gives way to it.
    """
    mesh = graded_mesh(kind, duration, steps)
    asked = [*stop_times]
    if not asked:
        return mesh
    stops = np.unique(np.array(asked, dtype=np.float64))
    nearest = np.abs(mesh[:, None] - stops).min(axis=1)
    kept = mesh[(nearest > SMALLEST_STEP * duration) | (mesh == 0.0) | (mesh == duration)]
    return np.union1d(kept, stops[stops < duration * (1.0 - SMALLEST_STEP)])


def graded_mesh(kind: TimeMesh, duration: float, steps: int) -> Vector:
    """Return tau_k = T (k/M)**p, k = 0, ..., M, shape (M + 1,), p = 1, 2 or 3 by the kind.

    The exercise boundary leaves the strike like a square root of tau (with a logarithm), so equal steps in
    sqrt(tau) keep second order where equal steps in tau lose it (Forsyth and Vetzal 2002). With equal steps in the
    cube root the logarithm no longer shows: the ratio of the errors of two meshes is 4 from a few steps on.
    """
    return duration * _unit_mesh(POWERS[kind], steps)


@lru_cache(maxsize=256)
def _unit_mesh(power: int, steps: int) -> Vector:
    mesh: Vector = np.linspace(0.0, 1.0, steps + 1) ** power
    return mesh
