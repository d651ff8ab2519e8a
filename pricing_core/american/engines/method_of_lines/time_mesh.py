"""Prescribed meshes of time to expiry: square-root and uniform."""

from collections.abc import Iterable

import numpy as np

from pricing_core.american.book.resolution import TimeMesh
from pricing_core.arrays import Vector

# Smallest step, as a share of the duration, after which the exercise region can be told from rounding; chosen.
SMALLEST_STEP = 1e-9


def prescribed_mesh(kind: TimeMesh, duration: float, steps: int, stop_times: Iterable[float] = ()) -> Vector:
    """Return the mesh of times from 0 to the duration, shape (m + 1,), with further times at which a step must end.

    Parameters
    ----------
    stop_times : iterable of float
        Above 0; a time of the mesh that lies next to one of them gives way to it.
    """
    mesh = (uniform_mesh if kind == "uniform" else square_root_mesh)(duration, steps)
    stops = np.unique(np.array([*stop_times], dtype=np.float64))
    if stops.size == 0:
        return mesh
    nearest = np.abs(mesh[:, None] - stops).min(axis=1)
    kept = mesh[(nearest > SMALLEST_STEP * duration) | (mesh == 0.0) | (mesh == duration)]
    return np.union1d(kept, stops[stops < duration * (1.0 - SMALLEST_STEP)])


def square_root_mesh(expiry: float, steps: int) -> Vector:
    """Return tau_k = T (k/M)**2, k = 0, ..., M, shape (M + 1,).

    The exercise boundary leaves the strike like a square root of tau (with a logarithm), so equal steps in
    sqrt(tau) keep second order where equal steps in tau lose it (Forsyth and Vetzal 2002).
    """
    return expiry * np.linspace(0.0, 1.0, steps + 1) ** 2


def uniform_mesh(expiry: float, steps: int) -> Vector:
    """Return tau_k = T k/M, k = 0, ..., M, shape (M + 1,)."""
    return np.linspace(0.0, expiry, steps + 1)
