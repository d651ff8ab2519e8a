"""Prescribed meshes of time to expiry: square-root and uniform."""

import numpy as np

from pricing_core.arrays import Vector


def square_root_mesh(expiry: float, steps: int) -> Vector:
    """Return tau_k = T (k/M)**2, k = 0, ..., M, shape (M + 1,).

    The exercise boundary leaves the strike like a square root of tau (with a logarithm), so equal steps in
    sqrt(tau) keep second order where equal steps in tau lose it (Forsyth and Vetzal 2002).
    """
    return expiry * np.linspace(0.0, 1.0, steps + 1) ** 2


def uniform_mesh(expiry: float, steps: int) -> Vector:
    """Return tau_k = T k/M, k = 0, ..., M, shape (M + 1,)."""
    return np.linspace(0.0, expiry, steps + 1)
