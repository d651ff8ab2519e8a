"""Collocation of the nonlinear problem (11.9)-(11.11) at midpoints, and its quadratic models."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, block_diag, csc_matrix, eye_array, hstack, kron, vstack

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.control.derivatives import hessian, jacobian

Table: TypeAlias = NDArray[np.float64]
Scalar = Callable[[float, Vector, Vector], float]
Field = Callable[[float, Vector, Vector], Vector]


@dataclass(frozen=True, slots=True, eq=False)
class Functions:
    """F, f, the mixed and the pure state part of g, and F_T, all of them checked: (t, x, u) -> number or vector."""

    reward: Scalar
    dynamics: Field
    mixed: Field  # (k1,)
    pure: Callable[[float, Vector], Vector]  # (k2,)
    final: Callable[[Vector], float]


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """What the merit function needs: the loss -J, the defects of (11.10) and the values of g."""

    loss: float
    defects: Vector  # (N n,)
    slacks: Vector  # (N k1 + N k2,): mixed at the midpoints, pure at the nodes


class Expansion(NamedTuple):
    """First and second derivatives at w_j of every interval, (N, ...), and at every node x_(j+1), (N, ...)."""

    gradients: Matrix  # (N, n + m): of -h F
    rates: Table  # (N, n, n + m)
    mixed: Table  # (N, k1, n + m)
    curved: Table  # (N, n + m, n + m): of the Lagrangian
    pure: Table  # (N, k2, n)
    node_curved: Table  # (N, n, n): of the Lagrangian's part at the nodes
    last: Vector  # (n,): of -F_T


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticModel:
    """min d^T W d/2 + gradient^T d subject to equations d + defects = 0, inequalities d + slacks >= 0."""

    W: Any
    gradient: Vector
    equations: Any
    inequalities: Any


class NonlinearProgramme:
    """Unknowns v = (x_1, ..., x_N, u_0, ..., u_(N-1)); everything local depends on w_j = ((x_j + x_(j+1))/2, u_j)."""

    def __init__(self, functions: Functions, x0: Vector, horizon: float, N: int, m: int) -> None:
        self.functions, self.x0, self.N, self.n, self.m = functions, x0, N, x0.size, m
        self.h = horizon / N
        self.nodes = np.linspace(0.0, horizon, N + 1)
        self.middles = 0.5 * (self.nodes[1:] + self.nodes[:-1])
        n = self.n
        before = eye_array(N, k=-1)
        means = kron(0.5 * (eye_array(N) + before), eye_array(n))
        order = np.concatenate(
            [np.arange(N * n).reshape(N, n), N * n + np.arange(N * m).reshape(N, m)], axis=1
        ).ravel()
        local = block_array([[means, None], [None, eye_array(N * m)]], format="csr")
        self.local = local[order]  # v -> all w_j, but for the share of x0
        self.differences = hstack([kron(eye_array(N) - before, eye_array(n)), csc_matrix((N * n, N * m))])

    def split(self, v: Vector) -> tuple[Matrix, Matrix]:
        """Return all nodes' x, shape (N + 1, n), and u, shape (N, m)."""
        x = v[: self.N * self.n].reshape(self.N, self.n)
        return np.vstack([self.x0, x]), v[self.N * self.n :].reshape(self.N, self.m)

    def values(self, v: Vector) -> Values:
        """Evaluate the loss and the constraints."""
        x, u = self.split(v)
        f, middle = self.functions, 0.5 * (x[1:] + x[:-1])
        places = list(zip(self.middles, middle, u, strict=True))
        loss = -self.h * sum(f.reward(*place) for place in places) - f.final(x[-1])
        rates = np.array([f.dynamics(*place) for place in places])
        pure = [f.pure(t, state) for t, state in zip(self.nodes[1:], x[1:], strict=True)]
        slacks = np.concatenate([*(f.mixed(*place) for place in places), *pure])
        return Values(loss, (x[1:] - x[:-1] - self.h * rates).ravel(), slacks)

    def expansion(self, v: Vector, costate: Matrix, duals: Vector) -> Expansion:
        """Expand interval by interval and node by node, the second order with these multipliers."""
        x, u = self.split(v)
        n, N, h = self.n, self.N, self.h
        f, w = self.functions, np.hstack([0.5 * (x[1:] + x[:-1]), u])
        k = f.mixed(self.middles[0], w[0, :n], u[0]).size
        mixed_duals, pure_duals = duals[: N * k].reshape(N, k), duals[N * k :].reshape(N, -1)
        gradients, rates, mixed, curved = [], [], [], []
        for j, t in enumerate(self.middles):

            def loss(z: Vector, t: float = t, j: int = j) -> float:
                a, b = z[:n], z[n:]
                held = f.reward(t, a, b) + costate[j] @ f.dynamics(t, a, b)
                return float(-h * held - mixed_duals[j] @ f.mixed(t, a, b))

            gradients.append(
                jacobian(lambda z, t=t: np.array([-h * f.reward(t, z[:n], z[n:])]), w[j])[0]  # type: ignore[misc]
            )
            rates.append(jacobian(lambda z, t=t: f.dynamics(t, z[:n], z[n:]), w[j]))  # type: ignore[misc]
            mixed.append(jacobian(lambda z, t=t: f.mixed(t, z[:n], z[n:]), w[j]))  # type: ignore[misc]
            curved.append(hessian(loss, w[j]))
        node_curved, pure = self._node_expansion(x, pure_duals)
        last = jacobian(lambda z: np.array([-f.final(z)]), x[-1])[0]
        return Expansion(
            np.array(gradients),
            np.array(rates),
            np.array(mixed),
            np.array(curved),
            np.array(pure),
            np.array(node_curved),
            last,
        )

    def _node_expansion(self, x: Matrix, duals: Matrix) -> tuple[list[Matrix], list[Matrix]]:
        """Return the second order of the pure constraints and of F_T, and the constraints' Jacobians."""
        f, N = self.functions, self.N
        curved: list[Matrix] = []
        rows: list[Matrix] = []
        for j, t in enumerate(self.nodes[1:]):
            ends = float(j == N - 1)

            def loss(z: Vector, t: float = t, j: int = j, ends: float = ends) -> float:
                return float(-duals[j] @ f.pure(t, z) - ends * f.final(z))

            curved.append(hessian(loss, x[j + 1]))
            rows.append(jacobian(lambda z, t=t: f.pure(t, z), x[j + 1]))  # type: ignore[misc]
        return curved, rows

    def model(self, parts: Expansion) -> QuadraticModel:
        """Put the parts together, W made positive semidefinite."""
        n, N, h = self.n, self.N, self.h
        none = csc_matrix((N * self.m, N * self.m))
        nodes = block_diag([block_diag([semidefinite_part(H) for H in parts.node_curved]), none])
        curved: Any = block_diag([semidefinite_part(H) for H in parts.curved])
        pure = hstack([block_diag(list(parts.pure)), csc_matrix((N * parts.pure.shape[1], N * self.m))])
        gradient = self.local.T @ np.concatenate(list(parts.gradients))
        gradient[(N - 1) * n : N * n] += parts.last
        return QuadraticModel(
            csc_matrix(self.local.T @ curved @ self.local + nodes),
            gradient,
            self.differences - h * block_diag(list(parts.rates)) @ self.local,
            vstack([csc_matrix(block_diag(list(parts.mixed)) @ self.local), pure]),
        )


def semidefinite_part(H: Matrix) -> Matrix:
    """Return the nearest positive semidefinite matrix.

    Examples
    --------
    >>> semidefinite_part(np.diag([2.0, -1.0]))
    array([[2., 0.],
           [0., 0.]])
    """
    values, vectors = np.linalg.eigh(H)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
