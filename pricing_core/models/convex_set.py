"""Closed convex sets K = {x | h_i(x) >= 0} with the projection (11.37): polyhedra, and sets of smooth functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_array, as_matrix, as_values, as_vector, check_callable
from pricing_core.errors import InfeasibleError, InvalidInputError, IterationLimitError, Told
from pricing_core.lcp import LCP, infeasibility_certificate
from pricing_core.models.nearest_point import nearest_point

VectorFunction: TypeAlias = Callable[[Vector], ArrayLike]
MatrixFunction: TypeAlias = Callable[[Vector], ArrayLike]

# Largest distance of a point on the boundary, as a share of the size of x, and of 1 where that is less.
ON_THE_BOUNDARY = 1e-9
# Last change of a projection, as a share of |x|.
PROJECTED = 1e-13
BY_DIFFERENCES = 1e-7
MOST_STEPS = 50
DIFFERENCE = float(np.finfo(np.float64).eps) ** (1 / 3)


class ConvexSet(Protocol):
    """What the projected dynamics need to know of K."""

    def slack(self, x: Vector) -> Vector:
        """Return h(x), shape (k,)."""
        ...

    def gradients(self, x: Vector) -> Matrix:
        """Return H(x), the gradients of the h_i as rows, shape (k, n)."""
        ...

    def project(self, x: Vector) -> Vector:
        """Return P(x) = argmin {|x - z|, z in K} (11.37)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Polyhedron:
    """K = {x | H x >= h}.

    Parameters
    ----------
    H : array_like, shape (k, n)
    h : array_like, shape (k,)

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite.
    InfeasibleError
        K is proved to be empty: some y >= 0 has H^T y = 0 and h^T y > 0.

    Examples
    --------
    >>> Polyhedron([[1, 1]], [2]).project(np.zeros(2))
    array([1., 1.])
    """

    H: Matrix
    h: Vector

    def __init__(self, H: ArrayLike, h: ArrayLike) -> None:
        object.__setattr__(self, "H", as_matrix("H", H))
        object.__setattr__(self, "h", as_vector("h", h, len(self.H)))
        certificate = _emptiness(self.H, self.h)
        if certificate is not None:
            rows = ", ".join(f"{weight:.6g} x row {i}" for i, weight in enumerate(certificate) if weight)
            raise InfeasibleError(f"no x has H x >= h: {rows} says 0 >= {float(self.h @ certificate):.6g}")

    def slack(self, x: Vector) -> Vector:
        """Return H x - h, shape (k,)."""
        return np.asarray(self.H @ x - self.h)

    def gradients(self, x: Vector) -> Matrix:
        """Return H."""
        return self.H

    def project(self, x: Vector) -> Vector:
        """Return P(x) = x + H^T u with 0 <= H x - h + H H^T u _|_ u >= 0."""
        return nearest_point(self.H, self.h, x).point


@dataclass(frozen=True, slots=True, eq=False)
class SmoothSet:
    """K = {x | h_i(x) >= 0} with concave and differentiable h_i.

    Parameters
    ----------
    constraints : callable
        h: from (n,) to (k,).
    constraint_gradients : callable, optional
        H: from (n,) to (k, n); central differences where missing, which are good to about 1e-10.

    Examples
    --------
    >>> disc = SmoothSet(lambda x: [1 - x @ x])
    >>> disc.project(np.array([3.0, 4.0])).round(9)
    array([0.6, 0.8])
    """

    constraints: VectorFunction
    constraint_gradients: MatrixFunction | None = None

    def __post_init__(self) -> None:
        check_callable("constraints", self.constraints, "x")
        if self.constraint_gradients is not None:
            check_callable("constraint_gradients", self.constraint_gradients, "x")

    def slack(self, x: Vector) -> Vector:
        """Return h(x), shape (k,)."""
        slack = as_array("constraints(x)", self.constraints(x))
        return as_values("constraints(x)", slack, (slack.size,))

    def gradients(self, x: Vector) -> Matrix:
        """Return H(x), shape (k, n)."""
        if self.constraint_gradients is None:
            return jacobian(self.slack, x)
        return as_values(
            "constraint_gradients(x)", self.constraint_gradients(x), (self.slack(x).size, x.size)
        )

    def project(self, x: Vector) -> Vector:
        """Return P(x) by sequential quadratic programming, from the third step on with the curvature of the h_i.

        Raises
        ------
        IterationLimitError
            50 steps do not suffice.
        NumericalError
            No common point of tangent planes was found, which K lies behind where the h_i are concave: K may be empty.
        """
        z, u, last = x, np.zeros(0), np.inf
        for step in range(MOST_STEPS):
            slack, H = self.slack(z), self.gradients(z)
            if step == 0 and (slack >= 0.0).all():
                return x
            curvature = self._curvature(z, u) if step > 1 else np.zeros((x.size, x.size))
            # Minimise |z + d - x|^2/2 + d^T curvature d/2 subject to slack + H d >= 0, in straightened coordinates.
            root = np.linalg.cholesky(np.eye(x.size) + curvature)
            inner = np.linalg.solve(root, np.column_stack([H.T, x - z]))
            moved, u = nearest_point(inner[:, :-1].T, -slack, inner[:, -1])
            change = np.linalg.solve(root.T, moved)
            z = z + change
            length = float(np.max(np.abs(change))) / max(1.0, float(np.max(np.abs(z))))
            # Differences hold the steps above their own error, where they fall no further.
            if length <= PROJECTED or (length <= BY_DIFFERENCES and length > 0.5 * last):
                return np.asarray(z)
            last = length
        raise IterationLimitError(
            f"{MOST_STEPS} steps do not lead to the projection of {x}: is K empty, or a constraint not concave?"
        )

    def _curvature(self, z: Vector, u: Vector) -> Matrix:
        """Return minus the second derivatives of u^T h, symmetric, shape (n, n)."""
        second = jacobian(lambda at: np.asarray(self.gradients(at).T @ u), z)
        values, vectors = np.linalg.eigh(-0.5 * (second + second.T))
        return np.asarray(
            vectors * np.maximum(values, 0.0) @ vectors.T
        )  # none is negative where the h_i are concave


def active_set(K: ConvexSet, x: Vector) -> list[int]:
    """Return I(x), the constraints with h_i(x) = 0, to within a change of x by 1e-9 of its size, or of 1."""
    return np.flatnonzero(K.slack(x) <= _tolerances(K, x)).tolist()


def check_inside(field: str, K: ConvexSet, x: Vector) -> None:
    """Raise InvalidInputError naming the first violated constraint unless x is in K, as closely as `active_set`."""
    slack = K.slack(x)
    for i in np.flatnonzero(slack < -_tolerances(K, x)).tolist():
        raise InvalidInputError(
            field,
            Told(np.array2string(x, precision=6, threshold=8)),
            f"in K, but constraint {i} is {slack[i]:g} < 0",
        )


def _tolerances(K: ConvexSet, x: Vector) -> Vector:
    size = max(1.0, float(np.max(np.abs(x), initial=0.0)))
    return np.asarray(ON_THE_BOUNDARY * size * np.abs(K.gradients(x)).sum(axis=1))


def jacobian(function: Callable[[Vector], Vector], x: Vector) -> Matrix:
    """Return the derivatives of a function by central differences, shape (k, n).

    Examples
    --------
    >>> jacobian(lambda x: np.array([x[0] * x[1]]), np.array([2.0, 3.0])).round(8)
    array([[3., 2.]])
    """
    columns = []
    for j, value in enumerate(x.tolist()):
        step = np.zeros(x.size)
        step[j] = DIFFERENCE * max(1.0, abs(value))
        columns.append((function(x + step) - function(x - step)) / (2.0 * step[j]))
    return np.column_stack(columns)


def _emptiness(H: Matrix, h: Vector) -> Vector | None:
    """Return y >= 0 with H^T y = 0 and h^T y > 0, exactly, or None: x = p - q in the LCP's p, q >= 0."""
    k, n = H.shape
    order = max(k, 2 * n)
    M, offsets = np.zeros((order, order)), np.zeros(order)
    M[:k, : 2 * n] = np.hstack([H, -H])
    offsets[:k] = -h
    found = infeasibility_certificate(LCP(M, offsets))
    return None if found is None else found[:k]
