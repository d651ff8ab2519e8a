"""The geometric algorithms of a mode (11.73)-(11.76), the same in floating-point and in rational numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.lcs.modes import ModeEquations

Table: TypeAlias = NDArray[Any]  # floats or rationals


class Arithmetic(NamedTuple):
    """The three operations on which the algorithm rests, in floating-point or rational numbers."""

    kernel: Callable[[Table], Table]
    image: Callable[[Table], Table]
    solution: Callable[[Table, Table], Table | None]
    identity: Callable[[int], Table]


def spaces(
    equations: ModeEquations, arithmetic: Arithmetic
) -> tuple[Table, Table, Table | None, Table | None]:
    """Return bases of V and T, W with P = V W, and F; W and F are None where P_I is not defined."""
    V = consistent_basis(equations, arithmetic)
    T = jump_basis(equations, arithmetic)
    n, d = V.shape
    stacked = np.vstack([equations.B, equations.D])
    if d + T.shape[1] != n or arithmetic.kernel(stacked).shape[1] > 0:  # (11.74)
        return V, T, None, None
    coordinates = arithmetic.solution(np.hstack([V, T]), arithmetic.identity(n))
    if coordinates is None:  # V and T meet (11.75)
        return V, T, None, None
    W = coordinates[:d]
    U = _inputs_on(equations, V, equations.A @ V, equations.C @ V, arithmetic)
    return V, T, W, None if U is None else U @ W


def consistent_basis(equations: ModeEquations, arithmetic: Arithmetic) -> Table:
    """Return a basis of V_I, shape (n, d), by the sequence (11.73)."""
    A, B, C, D = equations
    n = A.shape[0]
    V = arithmetic.identity(n)
    while True:
        L = arithmetic.kernel(V.T).T  # V = {x : L x = 0}
        zero = np.zeros((L.shape[0], B.shape[1]), dtype=L.dtype)
        pairs = arithmetic.kernel(np.block([[L @ A, L @ B], [C, D], [L, zero]]))
        smaller = arithmetic.image(pairs[:n])
        if smaller.shape[1] == V.shape[1]:
            return V
        V = smaller


def jump_basis(equations: ModeEquations, arithmetic: Arithmetic) -> Table:
    """Return a basis of T_I, shape (n, e), by the sequence (11.76)."""
    A, B, C, D = equations
    T = A[:, :0]
    while True:
        pairs = arithmetic.kernel(np.hstack([C @ T, D]))
        larger = arithmetic.image(np.hstack([T, np.hstack([A @ T, B]) @ pairs]))
        if larger.shape[1] == T.shape[1]:
            return T
        T = larger


def particular_point(
    augmented: ModeEquations, V: Table, arithmetic: Arithmetic
) -> tuple[Table | None, Table | None]:
    """Return an x, and the u_I that holds there, of a smooth solution with the last state constant at 1.

    V is a basis of V_I without that state. None stands for an x that does not exist, and for a u_I that does not
    or is not unique.
    """
    extended = consistent_basis(augmented, arithmetic)
    weights = arithmetic.solution(extended[-1:], arithmetic.identity(1))
    if weights is None:
        return None, None
    point = extended @ weights  # (n + 1, 1), the last entry 1
    A, B, C, D = augmented
    homogeneous = ModeEquations(A[:-1, :-1], B[:-1], C[:, :-1], D)
    inputs = _inputs_on(homogeneous, V, (A @ point)[:-1], C @ point, arithmetic)
    return point[:-1].ravel(), None if inputs is None else inputs.ravel()


def _inputs_on(
    equations: ModeEquations, V: Table, rates: Table, slacks: Table, arithmetic: Arithmetic
) -> Table | None:
    """Return the unique U with rates + B U in V and slacks + D U = 0, shape (|I|, columns), or None."""
    B, D = equations.B, equations.D
    rows = np.vstack([np.hstack([B, -V]), np.hstack([D, np.zeros((D.shape[0], V.shape[1]), dtype=V.dtype)])])
    if arithmetic.kernel(rows).shape[1] > 0:
        return None
    solution = arithmetic.solution(rows, -np.vstack([rates, slacks]))
    return None if solution is None else solution[: B.shape[1]]
