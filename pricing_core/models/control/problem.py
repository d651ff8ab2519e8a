"""The data of the linear-quadratic problem (11.21)-(11.23), and its complementarity system (11.25)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.system import LCS

ROUNDING = 1e-12
# Share of the product of its factors' sizes below which a Markov parameter is zero.
ZERO = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class LQData:
    """Minimise (1/2) int_0^T x^T Q x + u^T u dt with x' = A x + B u, x(0) = x0, C x >= bound."""

    A: Matrix  # (n, n)
    B: Matrix  # (n, m)
    C: Matrix  # (k, n)
    Q: Matrix  # (n, n)
    x0: Vector  # (n,)
    bound: Vector  # (k,)
    horizon: float

    @property
    def states(self) -> int:
        """The number n of state variables."""
        return int(self.A.shape[0])

    @property
    def slack_sizes(self) -> Vector:
        """What a slack is compared with: |C| |x0| + |bound|, shape (k,), and 1 where that is zero."""
        sizes = np.abs(self.C) @ np.abs(self.x0) + np.abs(self.bound)
        return np.where(sizes > 0.0, sizes, 1.0)


def hamiltonian_system(data: LQData) -> LCS:
    """Return (11.25): state (x, lambda), outputs y = C x - bound, inputs eta.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> hamiltonian_system(LQData(-one, one, one, one, 2 * one[0], one[0], 3.0)).A
    array([[-1.,  1.],
           [ 1.,  1.]])
    """
    n, k = data.states, data.C.shape[0]
    A = np.block([[data.A, data.B @ data.B.T], [data.Q, -data.A.T]])
    B = np.vstack([np.zeros((n, k)), -data.C.T])
    C = np.hstack([data.C, np.zeros((k, n))])
    return LCS(A, B, C, np.zeros((k, k)), g=-data.bound)


def constraint_orders(data: LQData) -> tuple[int | None, ...]:
    """Return for each constraint the least p with C_i A^(p-1) B != 0; None where the control never reaches it.

    The slack's p-th derivative is the first that the control enters.

    Examples
    --------
    The position of a double integrator is of order 2:

    >>> A, B, C = np.eye(2, k=1), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    >>> constraint_orders(LQData(A, B, C, np.eye(2), np.ones(2), np.zeros(1), 1.0))
    (2,)
    """
    return tuple(_order(row, data.A, data.B) for row in data.C)


def start_derivatives(data: LQData, constraint: int, count: int) -> Iterator[tuple[float, float]]:
    """Yield a slack's first derivatives at x0 without control, from itself on, with the sizes of what they add up."""
    row, size = data.C[constraint], np.abs(data.C[constraint])
    bound = float(data.bound[constraint])
    for _ in range(count):
        yield float(row @ data.x0) - bound, float(size @ np.abs(data.x0)) + abs(bound)
        row, size, bound = row @ data.A, size @ np.abs(data.A), 0.0


def held_at_start(data: LQData, orders: tuple[int | None, ...]) -> tuple[bool, ...]:
    """Tell of each constraint whether its slack and all derivatives before the control enters vanish at x0.

    Examples
    --------
    A double integrator at its bound can stay there from rest, not from motion:

    >>> A, B, C = np.eye(2, k=1), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    >>> for speed in (0.0, 1.0):
    ...     held_at_start(LQData(A, B, C, np.eye(2), np.array([1.0, speed]), np.ones(1), 1.0), (2,))
    (True,)
    (False,)
    """
    return tuple(
        all(abs(value) <= ROUNDING * size for value, size in start_derivatives(data, i, order or data.states))
        for i, order in enumerate(orders)
    )


def _order(row: Vector, A: Matrix, B: Matrix) -> int | None:
    size = np.abs(row)
    for order in range(1, A.shape[0] + 1):
        if np.any(np.abs(row @ B) > ZERO * float(np.max(size @ np.abs(B), initial=0.0))):
            return order
        row, size = row @ A, size @ np.abs(A)
    return None
