"""Derivatives of a user's functions by central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pricing_core.arrays import Matrix, Vector

FIRST = 6e-6  # relative step: about eps^(1/3)
SECOND = 1.2e-4  # about eps^(1/4)


def jacobian(function: Callable[[Vector], Vector], z: Vector) -> Matrix:
    """Return the derivative of a vector function, shape (values, z.size); error about 1e-10 relative.

    Examples
    --------
    >>> jacobian(lambda z: np.array([z[0] * z[1]]), np.array([2.0, 3.0])).round(8)
    array([[3., 2.]])
    """
    columns = []
    for i in range(z.size):
        step = np.zeros(z.size)
        step[i] = FIRST * (1.0 + abs(z[i]))
        columns.append((function(z + step) - function(z - step)) / (2.0 * step[i]))
    return np.column_stack(columns) if columns else np.zeros((function(z).size, 0))


def hessian(function: Callable[[Vector], float], z: Vector) -> Matrix:
    """Return the second derivatives of a scalar function, shape (z.size, z.size); error about 1e-7 relative.

    Examples
    --------
    >>> hessian(lambda z: float(z[0] ** 2 * z[1]), np.array([1.0, 2.0])).round(5)
    array([[4., 2.],
           [2., 0.]])
    """
    steps = SECOND * (1.0 + np.abs(z))
    moves = np.diag(steps)
    H = np.empty((z.size, z.size))
    for i in range(z.size):
        for j in range(i + 1):
            corners = [
                function(z + a * moves[i] + b * moves[j]) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
            ]
            H[i, j] = H[j, i] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                4 * steps[i] * steps[j]
            )
    return H
