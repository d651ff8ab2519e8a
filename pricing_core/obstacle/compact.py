"""The compact scheme of fourth order for D V'' + m V' = F on nodes that are whole numbers.

V'' + p V' = F/D with p = m/D, and h^2/12 (V'''' + 2 p V''') expressed by the equation itself (h = 1): sums over three
nodes on both sides. The weights of F/D are those of the integral against the hat function of the node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class CompactScheme:
    """sum_j weights_ij F_j = sum_j operator_ij V_j, the sums over j = i - 1, i, i + 1.

    Parameters
    ----------
    weights, operator : Matrix, shape (3, n)
        Rows for j = i - 1, i, i + 1; `weights` holds the factors 1/D_j.
    diffusion, peclet : Vector, shape (n,)
        D and p = m/D, which is the cell Peclet number.
    """

    weights: Matrix
    operator: Matrix
    diffusion: Vector
    peclet: Vector

    @classmethod
    def of(cls, diffusion: Vector, drift: Vector) -> CompactScheme:
        """Return the scheme of D > 0 and m at the nodes, shape (n,)."""
        p = drift / diffusion
        if np.all(p == p[0]):
            p1 = p2 = np.zeros(1)
        else:
            p1 = np.gradient(p)
            p2 = np.gradient(p1)
        second, first = 1.0 + (2.0 * p1 + p * p) / 12.0, p + (p2 + p * p1) / 12.0
        operator = np.array([second - first / 2.0, -2.0 * second, second + first / 2.0])
        inverse = np.empty(diffusion.size + 2)
        inverse[1:-1] = 1.0 / diffusion
        inverse[0] = inverse[-1] = 0.0
        weights = np.array(
            [
                (1.0 / 12.0 - p / 24.0) * inverse[:-2],
                10.0 / 12.0 * inverse[1:-1],
                (1.0 / 12.0 + p / 24.0) * inverse[2:],
            ]
        )
        return cls(weights, operator, diffusion, p)


def neighbouring(v: Vector) -> Matrix:
    """Return v_{i-1}, v_i and v_{i+1} at the nodes, shape (3, n); beyond an end its own value."""
    return np.array([np.append(v[:1], v[:-1]), v, np.append(v[1:], v[-1:])])


def product(bands: Matrix, v: Vector) -> Vector:
    """Return the sums over j = i - 1, i, i + 1 at the inner nodes, shape (n - 2,)."""
    return np.asarray(bands[0, 1:-1] * v[:-2] + bands[1, 1:-1] * v[1:-1] + bands[2, 1:-1] * v[2:])
