"""Lower bounds of the control's energy that weights on the constraints prove."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from pricing_core.arrays import Matrix
from pricing_core.models.control.problem import LQData

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
ROUNDING = 1e-12
# Share of the largest weight that an interior-point method leaves of a zero.
NEGLIGIBLE = 1e-7


def least_energy(data: LQData, weights: Matrix) -> float:
    """Return a number that int_0^T u^T u dt exceeds for every control with C x >= bound; inf where there is none.

    Weights w_j >= 0 at the nodes say 0 <= sum w_j^T (C x(t_j) - bound) = int p^T B u dt - deficit, with the deficit
    that u = 0 leaves and p(s) = sum over t_j > s of e^(A^T (t_j - s)) C^T w_j. By Cauchy and Schwarz the energy is at
    least (deficit/|B^T p|)^2. The number is 0 where the weights prove nothing.

    Parameters
    ----------
    weights : Matrix, shape (N + 1, k)
        At equally spaced nodes from 0 to the horizon; negative ones count as zero.

    Examples
    --------
    x' = u from 0 with x(1) >= 2 needs int u^2 dt >= 4:

    >>> one, zero = np.ones((1, 1)), np.zeros((1, 1))
    >>> data = LQData(zero, one, one, zero, zero[0], 2 * one[0], 1.0)
    >>> round(least_energy(data, np.array([[0.0], [0.0], [1.0]])), 9)
    4.0
    """
    small = NEGLIGIBLE * float(np.max(weights, initial=0.0))
    return max(_least_energy(data, np.where(weights > level, weights, 0.0)) for level in (0.0, small))


def _least_energy(data: LQData, w: Matrix) -> float:
    h = data.horizon / (len(w) - 1)
    back = expm(h * data.A.T)
    flows = [expm(0.5 * h * (node + 1.0) * data.A.T) for node in GAUSS_NODES]
    p, norm, size = np.zeros(data.states), 0.0, 0.0
    for j in range(len(w) - 1, 0, -1):
        p = p + data.C.T @ w[j]
        values = [data.B.T @ (flow @ p) for flow in flows]
        norm += 0.5 * h * sum(a * float(v @ v) for a, v in zip(GAUSS_WEIGHTS, values, strict=True))
        size = max(size, float(np.max(np.abs(data.B.T) @ np.abs(p))))
        p = back @ p
    deficit = float(np.sum(w[1:] @ data.bound)) - float(p @ data.x0)
    level = ROUNDING * (float(np.sum(w[1:] @ np.abs(data.bound))) + float(np.abs(p) @ np.abs(data.x0)))
    if deficit <= level:
        return 0.0
    return math.inf if norm <= (ROUNDING * size) ** 2 * data.horizon else float(deficit**2 / norm)
