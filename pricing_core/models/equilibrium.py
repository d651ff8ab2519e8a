"""Variational inequalities: x in K with <F(x), z - x> >= 0 for all z in K (11.36)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InfeasibleError, IterationLimitError, NumericalError
from pricing_core.lcp import MixedLCP, solve
from pricing_core.models.convex_set import ConvexSet, Polyhedron, active_set, jacobian
from pricing_core.models.tangent_cone import project_velocity

NOT_FOUND = (
    "no equilibrium was found, and none was proved not to exist: change the constraints so that x is bounded, or "
    "simulate and see where the motion goes"
)
NONE_EXISTS = (
    "there is no equilibrium: no x with H x >= h has F(x) = H^T u with u >= 0, which is proved for the numbers as "
    "given"
)
CONVERGED = 1e-11  # residual, as a share of the size of x and F
ACCEPTED = 1e-8
ON_THE_DATA = 1e-7  # the same of an affine problem, as a share of the size that its data give x
ROUNDING = float(np.finfo(np.float64).eps)
MOST_STEPS = 500
HALVINGS = 8
SAFE = 0.7  # length of an extragradient step, in inverse Lipschitz constants


@dataclass(frozen=True, slots=True, eq=False)
class Equilibrium:
    """A solution of (11.36): F(x) = H(x)^T u, 0 <= h(x) _|_ u >= 0.

    Parameters
    ----------
    x : Vector, shape (n,)
    u : Vector, shape (k,)
        The multipliers of the constraints.
    residual : float
        max |x - P(x - F(x))|: zero exactly at the solutions.
    method : {"lcp", "newton"}
    """

    x: Vector
    u: Vector
    residual: float
    method: Literal["lcp", "newton"]


def solve_affine(matrix: Matrix, vector: Vector, K: Polyhedron) -> Equilibrium:
    """Solve (11.36) for F(x) = matrix x + vector on a polyhedron by the mixed LCP in x, which is free, and u.

    An answer counts where it misses the variational inequality by no more than 1e-7 of the size that the data give x,
    however large it is itself.

    Raises
    ------
    InfeasibleError
        Proved: no x in K has F(x) in the cone of the gradients of the constraints.
    NumericalError
        No solution was found; there may be one.

    Examples
    --------
    >>> found = solve_affine(np.eye(2), np.array([1.0, 2.0]), Polyhedron(np.eye(2), np.zeros(2)))
    >>> found.x, found.u
    (array([0., 0.]), array([1., 2.]))
    """
    n, k = vector.size, K.h.size
    M = np.block([[matrix, -K.H.T], [K.H, np.zeros((k, k))]])
    lower = np.append(np.full(n, -np.inf), np.zeros(k))
    try:
        z = solve(MixedLCP(M, np.append(vector, -K.h), lower, np.inf)).z
    except InfeasibleError:
        raise InfeasibleError(NONE_EXISTS) from None
    except NumericalError:
        raise NumericalError(NOT_FOUND) from None
    if _misses(matrix, vector, K, z[:n]) > ON_THE_DATA:
        raise NumericalError(NOT_FOUND)
    return Equilibrium(z[:n], z[n:], _residual(lambda at: matrix @ at + vector, K, z[:n]), "lcp")


def _misses(matrix: Matrix, vector: Vector, K: Polyhedron, x: Vector) -> float:
    """Return max |x - P(x - tau F(x))| and its rounding, over the size that the data give x; tau makes units agree."""
    rows, slopes = np.linalg.norm(K.H, axis=1), float(np.linalg.norm(matrix))
    bounds = np.abs(K.h[rows > 0.0]) / rows[rows > 0.0]
    size = float(bounds.max(initial=0.0))
    force = max(float(np.linalg.norm(vector)), slopes * size)
    size = max(size, force / slopes if slopes else 0.0)
    if force == 0.0 or size == 0.0:  # no number of the data has the unit of x, or of F
        size, force = max(size, 1.0), max(force, 1.0)
    try:
        nearest = K.project(x - size / force * (matrix @ x + vector))
    except NumericalError:
        return np.inf
    rounding = ROUNDING * float(np.linalg.norm(x)) * (1.0 + size / force * slopes)
    return (float(np.max(np.abs(x - nearest))) + rounding) / size


def solve_smooth(F: Callable[[Vector], Vector], K: ConvexSet, start: Vector) -> Equilibrium:
    """Solve (11.36) from a start by Newton's method for variational inequalities, safeguarded by extragradient steps.

    Each step solves the problem with F and h linearised, the curvature of h included (Josephy 1979); where that does
    not bring the residual down, an extragradient step is made, which converges where F is monotone (Korpelevich 1976).

    Raises
    ------
    IterationLimitError
        500 steps do not reach a residual of 1e-8: F is not monotone, or there is no solution.

    Examples
    --------
    >>> found = solve_smooth(lambda x: np.exp(x) - 2.0, Polyhedron([[-1.0]], [-3.0]), np.zeros(1))
    >>> found.x.round(12)
    array([0.69314718])
    """
    x, length = K.project(start), 1.0
    best, best_residual = x, np.inf
    for _ in range(MOST_STEPS):
        residual = _residual(F, K, x)
        if residual < best_residual:
            best, best_residual = x, residual
        if residual <= CONVERGED * _size(F, x):
            break
        following = _newton_step(F, K, x, residual)
        if following is None:
            following, length = _extragradient_step(F, K, x, length)
        x = following
    u = _multipliers(F, K, best)
    return _checked(F, K, best, u)


def _residual(F: Callable[[Vector], Vector], K: ConvexSet, x: Vector) -> float:
    return float(np.max(np.abs(x - K.project(x - F(x)))))


def _size(F: Callable[[Vector], Vector], x: Vector) -> float:
    return max(1.0, float(np.max(np.abs(x))), float(np.max(np.abs(F(x)))))


def _multipliers(F: Callable[[Vector], Vector], K: ConvexSet, x: Vector) -> Vector:
    active, H = active_set(K, x), K.gradients(x)
    u = np.zeros(len(H))
    u[active] = project_velocity(H[active], -F(x)).u
    return u


def _newton_step(F: Callable[[Vector], Vector], K: ConvexSet, x: Vector, residual: float) -> Vector | None:
    """Return a point with at most 0.9 of the residual on the way to the solution of the linearised problem."""
    u, H = _multipliers(F, K, x), K.gradients(x)
    matrix = jacobian(F, x)
    if not isinstance(K, Polyhedron) and u.any():
        matrix = matrix - jacobian(lambda at: np.asarray(K.gradients(at).T @ u), x)
    try:
        target = solve_affine(matrix, F(x) - matrix @ x, Polyhedron(H, H @ x - K.slack(x))).x
    except NumericalError:
        return None
    for halving in range(HALVINGS):
        candidate = K.project(x + 0.5**halving * (target - x))
        if _residual(F, K, candidate) <= 0.9 * residual:
            return candidate
    return None


def _extragradient_step(
    F: Callable[[Vector], Vector], K: ConvexSet, x: Vector, length: float
) -> tuple[Vector, float]:
    """Return P(x - length F(P(x - length F(x)))) with a length that suits the slope of F, and the next length."""
    slope = F(x)
    while True:
        middle = K.project(x - length * slope)
        if (
            length * np.linalg.norm(F(middle) - slope) <= SAFE * np.linalg.norm(middle - x)
            or length < CONVERGED
        ):
            return K.project(x - length * F(middle)), 1.5 * length
        length *= 0.5


def _checked(F: Callable[[Vector], Vector], K: ConvexSet, x: Vector, u: Vector) -> Equilibrium:
    residual = _residual(F, K, x)
    if not residual <= ACCEPTED * _size(F, x):
        raise IterationLimitError(
            f"{MOST_STEPS} steps leave a residual of {residual:.1e}: try another start, or simulate from there; "
            "there may be no equilibrium"
        )
    return Equilibrium(x, u, residual, "newton")
