"""Strict solutions of the passivity inequality, from Riccati and Lyapunov equations, and where there are none."""

from __future__ import annotations

import numpy as np
from scipy.linalg import schur, solve_continuous_lyapunov

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.balancing import Units, balancing_units
from pricing_core.linalg.rational import RationalMatrix, exact_product, rational_array, rounded
from pricing_core.linalg.rational_definite import is_clearly_positive_definite

MARGINS = (1.0, 1e-1, 1e-2, 1e-4, 1e-6, 1e-8)  # in units in which the data are of order 1
DECAYS = 1e-12  # share of A that is more than the rounding of its eigenvalues
DIGITS = (8, 20, 40)  # binary, to which a solution is rounded, in turn
ON_THE_AXIS = (
    1e-5  # share of the Hamiltonian matrix below which the real part of an eigenvalue may be rounding
)


def strict_storage(
    A: RationalMatrix, B: RationalMatrix, C: RationalMatrix, E: RationalMatrix
) -> RationalMatrix | None:
    """Return Q > 0 with S = [[-(A^T Q + Q A), C^T - Q B], [C - B^T Q, E]] > 0, verified, or None; E > 0.

    It solves A^T Q + Q A + (Q B - C^T) E^-1 (B^T Q - C) + margin = 0, for one margin after the other.

    Notes
    -----
    Cost: a Schur form of order 2 n for each margin. Source: Anderson 1967; Boyd, Balakrishnan and Kabamba 1989.

    Examples
    --------
    >>> one = rational_array(np.array([[1]]))
    >>> Q = strict_storage(-one, one, one, one)
    >>> bool(0 < Q[0, 0] < 4)
    True
    """
    units, exact = _balanced(A, B, C, E)
    data = [rounded(part) for part in exact]
    for margin in MARGINS:
        Q = _solution(margin, *data)
        if Q is None:
            continue
        for digits in DIGITS:
            candidate = rational_array(_shortened(Q, digits))
            if _is_strict(candidate, *exact):
                return np.asarray(candidate / (units.rate * np.outer(units.state, units.state)))
    return None


def critical_frequencies(
    A: RationalMatrix, B: RationalMatrix, C: RationalMatrix, E: RationalMatrix
) -> tuple[float, ...]:
    """Return the omega > 0 at which G(i omega) + G(i omega)^* may be singular, and those between them; E > 0."""
    F, quadratic, constant = _riccati(*(rounded(part) for part in (A, B, C, E)))
    matrix = np.block([[F, quadratic], [-constant, -F.T]])
    values = np.linalg.eigvals(matrix)
    near = np.abs(values.real) <= ON_THE_AXIS * max(float(np.abs(values).max(initial=0.0)), 1e-300)
    heights = np.unique(values.imag[near & (values.imag > 0.0)])
    between = 0.5 * (np.concatenate([[0.0], heights]) + np.concatenate([heights, 2.0 * heights[-1:]]))
    return tuple(heights.tolist()) + tuple(between.tolist() if heights.size else [])


def _balanced(*data: RationalMatrix) -> tuple[Units, list[RationalMatrix]]:
    """Return exact units in which the data are of order 1, and the data in them."""
    found = balancing_units(*(rounded(part) for part in data))
    rate = rational_array(np.array([found.rate]))[0]
    units = Units(rational_array(found.state), rational_array(found.pair), rate)
    return units, [*units.apply(*data)]


def _riccati(A: Matrix, B: Matrix, C: Matrix, E: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return F, G, H of F^T Q + Q F + Q G Q + H = 0."""
    if not B.shape[1]:
        return A, np.zeros_like(A), np.zeros_like(A)
    solved = np.linalg.solve(E, np.hstack([C, B.T]))
    n = len(A)
    return A - B @ solved[:, :n], B @ solved[:, n:], C.T @ solved[:, :n]


def _solution(margin: float, A: Matrix, B: Matrix, C: Matrix, E: Matrix) -> Matrix | None:
    """Return the least Q of the Riccati equation in floating point, None where it has none."""
    n = len(A)
    if np.linalg.eigvals(A).real.max() >= -DECAYS * np.abs(A).max():
        return None
    F, quadratic, constant = _riccati(A, B, C, E)
    constant = constant + margin * np.eye(n)
    if not B.shape[1]:
        Q = solve_continuous_lyapunov(F.T, -constant)
    else:
        try:
            _, basis, count = schur(np.block([[F, quadratic], [-constant, -F.T]]), sort="lhp")
        except np.linalg.LinAlgError:  # eigenvalues on the axis, or nearly so
            return None
        if count != n or np.linalg.matrix_rank(basis[:n, :n]) < n:
            return None
        Q = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T)
    Q = 0.5 * (Q + Q.T)
    return np.asarray(Q) if np.isfinite(Q).all() else None


def _is_strict(
    Q: RationalMatrix, A: RationalMatrix, B: RationalMatrix, C: RationalMatrix, E: RationalMatrix
) -> bool:
    if not is_clearly_positive_definite(Q):
        return False
    QA, corner = exact_product(Q, A), C.T - exact_product(Q, B)
    return is_clearly_positive_definite(np.block([[-(QA + QA.T), corner], [corner.T, E]]))


def _shortened(theta: Vector | Matrix, digits: int) -> Matrix:
    """Round to so many binary digits of the largest entry."""
    size = 2.0 ** np.ceil(np.log2(np.max(np.abs(theta), initial=1e-300)))
    return np.asarray(np.rint(theta / size * 2.0**digits) * (size * 2.0**-digits))
