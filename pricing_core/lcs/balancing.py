"""Units in which the entries of a linear complementarity system are of order 1."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pricing_core.arrays import Matrix, Vector


class Units(NamedTuple):
    """Powers of two: x = state * x', u = pair * u', y' = pair * y, t' = rate * t.

    Complementarity and passivity are the same in all units of this form.
    """

    state: NDArray[Any]  # (n,)
    pair: NDArray[Any]  # (k,)
    rate: Any

    def apply(
        self, A: NDArray[Any], B: NDArray[Any], C: NDArray[Any], D: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return A', B', C', D' in these units: exact, of floats or of rationals like the units."""
        x, u = self.state, self.pair
        return (
            A * x / (self.rate * x[:, None]),
            B * u / (self.rate * x[:, None]),
            C * x * u[:, None],
            D * u * u[:, None],
        )


def balancing_units(A: Matrix, B: Matrix, C: Matrix, D: Matrix) -> Units:
    """Return units in which the logarithms of the nonzero entries have the least sum of squares.

    Cost: a least-squares problem with n + k + 1 unknowns and one equation for every nonzero entry.

    Examples
    --------
    A coil of 1/100 H and a capacitor of 1e-6 F:

    >>> B, C, D = np.zeros((2, 0)), np.zeros((0, 2)), np.zeros((0, 0))
    >>> A = np.array([[0.0, -1e6], [100.0, 0.0]])
    >>> balancing_units(A, B, C, D).apply(A, B, C, D)[0]
    array([[ 0.        , -1.90734863],
           [ 0.78125   ,  0.        ]])
    """
    n, k = B.shape
    time = n + k
    equations = [
        _equations(A, (0, -1), (0, 1), time),
        _equations(B, (0, -1), (n, 1), time),
        _equations(C, (n, 1), (0, 1), None),
        _equations(D, (n, 1), (n, 1), None),
    ]
    logarithms = np.concatenate([logarithm for logarithm, _, _ in equations])
    unknowns = np.concatenate([unknown for _, unknown, _ in equations])  # (entries, 3)
    weights = np.concatenate([weight for _, _, weight in equations])
    rows = np.repeat(np.arange(logarithms.size), 3)
    effects = csr_array((weights.ravel(), (rows, unknowns.ravel())), shape=(logarithms.size, time + 1))
    exponents = np.linalg.lstsq((effects.T @ effects).toarray(), -(effects.T @ logarithms), rcond=1e-10)[0]
    powers = np.exp2(np.clip(np.rint(exponents), -200, 200))
    return Units(powers[:n], powers[n : n + k], float(1.0 / powers[-1]))


def _equations(
    M: Matrix, row: tuple[int, int], column: tuple[int, int], time: int | None
) -> tuple[Vector, NDArray[np.int64], Matrix]:
    """Return log2 of the nonzero entries, and the unknowns that change it with their weights, shapes (m,), (m, 3).

    `row` and `column` are the first unknown that belongs to them, and its weight.
    """
    i, j = np.nonzero(M)
    last = np.full(i.size, 0 if time is None else time)
    unknowns = np.stack([row[0] + i, column[0] + j, last], axis=1)
    weights = np.tile([row[1], column[1], 0.0 if time is None else 1.0], (i.size, 1))
    return np.log2(np.abs(M[i, j])), unknowns, weights
