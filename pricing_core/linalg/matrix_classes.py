"""Matrix classes of complementarity theory: Z, M, H+, positive definite and P, with certificates.

Source of the definitions: Cottle, Pang, Stone 1992, chapter 3; Berman and Plemmons 1994, chapter 6.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.errors import IterationLimitError, NumericalError
from pricing_core.linalg.coefficients import (
    Coefficients,
    absolute,
    as_coefficients,
    dense,
    diagonal_of,
    off_diagonal_entries,
)
from pricing_core.linalg.determinant import determinant_sign, schur_complement
from pricing_core.linalg.multigrid import Multigrid, solve_preconditioned
from pricing_core.linalg.tridiagonal import Tridiagonal

FACTORED = 3000  # order up to which a sparse matrix is factored: fill-in may cost minutes beyond
POWERS = 50
LARGEST_P_ORDER = 20  # 2**n Schur complements are formed beyond the quick tests
EPSILON, TINY = float(np.finfo(np.float64).eps), 1e-300
DOUBTFUL = 1e-10  # minors of order 2 this small relative to the product of the diagonal are decided exactly
SAFE = 1.0 + 1e-9  # covers the rounding of an error bound itself


def is_z_matrix(M: object) -> bool:
    """Tell whether no entry off the diagonal is positive."""
    return not (off_diagonal_entries(as_coefficients("M", M)) > 0.0).any()


def is_m_matrix(M: object) -> bool:
    """Tell whether M is a nonsingular M-matrix: a Z-matrix with an x > 0 for which M x > 0.

    Parameters
    ----------
    M : array_like (n, n), sparse (n, n) or Tridiagonal
        Cost: one linear system in its storage. A matrix singular to within rounding counts as no M-matrix.

    Examples
    --------
    >>> is_m_matrix([[2.0, -1.0], [-1.0, 2.0]]), is_m_matrix([[1.0, -1.0], [-1.0, 1.0]])
    (True, False)
    """
    A = as_coefficients("M", M)
    return is_z_matrix(A) and (_is_dominant(A) or semipositivity_vector(A) is not None)


def is_h_plus_matrix(M: object) -> bool:
    """Tell whether the diagonal is positive and 2 diag(M) - |M| is a nonsingular M-matrix.

    Examples
    --------
    >>> is_h_plus_matrix([[2.0, 1.0], [-1.0, 2.0]]), is_h_plus_matrix([[1.0, 2.0], [-1.0, 1.0]])
    (True, False)
    """
    A = as_coefficients("M", M)
    if not (diagonal_of(A) > 0.0).all():
        return False
    comparison = _comparison(A)
    if _is_dominant(comparison):
        return True
    known = _by_powers(comparison) if isinstance(comparison, csr_array) else None
    return semipositivity_vector(comparison) is not None if known is None else known


def semipositivity_vector(M: object) -> Vector | None:
    """Return x > 0 with M x > 0, found as M^-1 diag(M) for a Z-matrix with positive diagonal, or None.

    For a Z-matrix such an x exists iff M is a nonsingular M-matrix. M x > 0 is accepted only beyond the
    rounding error of the product.

    Examples
    --------
    >>> semipositivity_vector([[2.0, -1.0], [-1.0, 2.0]])
    array([2., 2.])
    """
    A = as_coefficients("M", M)
    diagonal = diagonal_of(A)
    if not (diagonal > 0.0).all():
        return None
    x = _solution(A, diagonal)
    if x is None or not (np.isfinite(x) & (x > 0.0)).all():
        return None
    return x if (np.asarray(A @ x) > _rounding(A, x)).all() else None


def _by_powers(A: csr_array) -> bool | None:
    """Tell whether a Z-matrix D - B with diagonal D > 0 is a nonsingular M-matrix, None where 50 products do not tell.

    For x > 0 the spectral radius of D^-1 B lies between the least and the largest of (D^-1 B x)_i / x_i (Collatz 1942,
    Wielandt 1950); x follows the powers of D^-1 B + I, which tend to its Perron vector.
    """
    diagonal = A.diagonal()
    x = np.ones(A.shape[0])
    for _ in range(POWERS):
        product = np.asarray(A @ x)
        if (product > _rounding(A, x)).all():
            return True
        if (product < 0.0).all():
            return False
        x = 2.0 * x - product / diagonal
        x = np.maximum(x / x.max(), TINY)
    return None


def _is_dominant(A: Coefficients) -> bool:
    """Tell whether all row sums of a Z-matrix are positive beyond their rounding."""
    ones = np.ones(A.shape[0])
    return bool((np.asarray(A @ ones) > _rounding(A, ones)).all())


def _rounding(A: Coefficients, x: Vector) -> Vector:
    """Return a bound on the rounding error of A x for x >= 0 (Higham 2002, (3.5))."""
    terms = A.shape[0] if isinstance(A, np.ndarray) else 3
    if isinstance(A, csr_array):
        terms = int(np.max(np.diff(A.indptr), initial=0))
    return np.asarray((terms + 5.0) * EPSILON * (absolute(A) @ x))


def is_positive_definite(M: object) -> bool:
    """Tell whether x^T M x > 0 for all x != 0: M need not be symmetric.

    The symmetric part, scaled to a unit diagonal, must have its smallest eigenvalue above 8 n**2 eps, more than what
    rounding can do to it, so that True is certain. Cost: O(n**3).

    Examples
    --------
    >>> is_positive_definite([[1.0, -1.0], [1.0, 1.0]]), is_positive_definite([[1.0, 2.0], [2.0, 1.0]])
    (True, False)
    """
    A = dense(as_coefficients("M", M))
    diagonal = np.diagonal(A)
    if not (diagonal > 0.0).all():
        return False
    scale = 1.0 / np.sqrt(diagonal)
    symmetric = 0.5 * scale[:, None] * (A + A.T) * scale
    smallest = float(np.min(np.linalg.eigvalsh(symmetric), initial=1.0))
    return smallest > 8.0 * len(A) ** 2 * EPSILON * max(1.0, float(np.max(np.abs(symmetric), initial=0.0)))


def is_p_matrix(M: object) -> bool:
    """Tell whether every principal minor is positive; then M z + q has exactly one LCP solution for every q.

    Raises
    ------
    IterationLimitError
        n > 20 and none of the quick tests decides.

    Notes
    -----
    Cost and source: see `p_matrix_violation`.

    Examples
    --------
    >>> is_p_matrix([[1.0, -2.0], [2.0, 1.0]]), is_p_matrix([[1.0, 2.0], [2.0, 1.0]])
    (True, False)
    """
    return p_matrix_violation(M) is None


def p_matrix_violation(M: object) -> IndexSet | None:
    """Return indices of a principal minor that is not positive, or None where M is a P-matrix.

    Quick answers come from the diagonal, the minors of order 2, and the positive definite and H+ classes (all
    P). The rest is decided by the recursion "A is P iff a_11 > 0, and A without its first row and column and
    A / a_11 (Schur complement) are P", on all branches of one level at a time.

    Parameters
    ----------
    M : array_like (n, n), sparse (n, n) or Tridiagonal
        The recursion forms 2**n pivots; n <= 20 (about two seconds). Each has a bound on its rounding; where
        that does not settle its sign, an exact determinant does: the answer is a theorem on the numbers as given.

    Raises
    ------
    IterationLimitError
        n > 20 and none of the quick tests decides.

    Notes
    -----
    Source: Tsatsomeros and Li 2000, A recursive test for P-matrices.

    Examples
    --------
    >>> p_matrix_violation([[1.0, 2.0, 0.0], [0.0, 1.0, 2.0], [2.0, 0.0, 1.0]]) is None
    True
    >>> p_matrix_violation([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    (1, 2)
    """
    A = dense(as_coefficients("M", M))
    small = _small_violation(A)
    if small is not None:
        return small
    if is_positive_definite(A) or is_h_plus_matrix(A):
        return None
    if len(A) > LARGEST_P_ORDER:
        raise IterationLimitError(
            f"no quick test decides whether this matrix is P, and 2**{len(A)} minors are too many: "
            f"the largest order for that is {LARGEST_P_ORDER}"
        )
    return _violation_by_schur_complements(A)


def _small_violation(A: Matrix) -> IndexSet | None:
    """Return a minor of order 1 or 2 that is not positive."""
    diagonal = np.diagonal(A)
    if (diagonal <= 0.0).any():
        return (int(np.argmax(diagonal <= 0.0)),)
    scaled = _near_unit_diagonal(A)
    with np.errstate(over="ignore", invalid="ignore"):
        doubtful = ~(
            scaled * scaled.T < (1.0 - DOUBTFUL) * np.outer(np.diagonal(scaled), np.diagonal(scaled))
        )
    rows, columns = np.nonzero(np.triu(doubtful, 1))
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        if determinant_sign(A[np.ix_((i, j), (i, j))]) <= 0:
            return i, j
    return None


def _violation_by_schur_complements(A: Matrix) -> IndexSet | None:
    n = len(A)
    scaled = _near_unit_diagonal(A)
    complements = scaled[None]  # (branches, n - k, n - k): A / A_SS without the rows before k
    errors = np.zeros_like(complements)  # bounds on what rounding did to them
    chosen = np.zeros((1, n), dtype=np.bool_)  # the index set S of each branch
    for k in range(n):
        # The pivot of j in the branch of S is det A_{S+j} / det A_SS.
        pivots = np.diagonal(complements, axis1=1, axis2=2)
        doubts = np.diagonal(errors, axis1=1, axis2=2)
        negative = np.argwhere(pivots + doubts < 0.0)
        if negative.size:
            branch, j = negative[0].tolist()
            return *np.flatnonzero(chosen[branch]).tolist(), k + j
        with_k = chosen.copy()
        with_k[:, k] = True
        next_complements, next_errors = _eliminated(complements, errors)
        for branch in np.flatnonzero(~(pivots[:, 0] > doubts[:, 0])).tolist():
            minor = tuple(np.flatnonzero(with_k[branch]).tolist())
            if determinant_sign(scaled[np.ix_(minor, minor)]) <= 0:
                return minor
            next_complements[branch] = schur_complement(scaled, minor, tuple(range(k + 1, n)))
            next_errors[branch] = EPSILON * np.abs(next_complements[branch]) + TINY
        complements = np.concatenate([complements[:, 1:, 1:], next_complements])
        errors = np.concatenate([errors[:, 1:, 1:], next_errors])
        chosen = np.concatenate([chosen, with_k])
    return None


def _eliminated(values: Matrix, errors: Matrix) -> tuple[Matrix, Matrix]:
    """Return the Schur complements of the first entries, and bounds on their errors, for pivots above theirs."""
    pivot, doubt = values[:, :1, :1], errors[:, :1, :1]
    column, row = np.abs(values[:, 1:, :1]), np.abs(values[:, :1, 1:])
    column_error, row_error = errors[:, 1:, :1], errors[:, :1, 1:]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        least = pivot - doubt
        change = values[:, 1:, :1] / pivot * values[:, :1, 1:]
        error = (column * row_error + column_error * (row + row_error)) / least + column * row / pivot * (
            doubt / least
        )
        error += errors[:, 1:, 1:] + 4.0 * EPSILON * (np.abs(change) + np.abs(values[:, 1:, 1:]))
        return values[:, 1:, 1:] - change, SAFE * error + TINY


def _near_unit_diagonal(A: Matrix) -> Matrix:
    """Return D A D, D powers of two, with a diagonal from 1/2 to 2: the same signs of all principal minors."""
    exponents = -(np.frexp(np.diagonal(A))[1] // 2)
    return np.asarray(np.ldexp(A, exponents[:, None] + exponents))


def _comparison(A: Coefficients) -> Coefficients:
    """Return 2 diag(A) - |A| for a matrix with positive diagonal."""
    if isinstance(A, Tridiagonal):
        return Tridiagonal(-np.abs(A.lower), A.diagonal, -np.abs(A.upper))
    if isinstance(A, csr_array):
        comparison = -abs(A)
        comparison.setdiag(A.diagonal())
        return csr_array(comparison)
    return np.where(np.eye(len(A), dtype=np.bool_), A, -np.abs(A))


def _solution(A: Coefficients, b: Vector) -> Vector | None:
    try:
        if isinstance(A, Tridiagonal):
            return A.solve(b)
        if isinstance(A, csr_array):
            if len(b) <= FACTORED:
                return np.asarray(splu(A.tocsc()).solve(b))
            inverse = Multigrid.of(A, None).inverse
            return solve_preconditioned(A, b, inverse, symmetric=False, tolerance=1e-8, limit=90)[0]
        return np.asarray(np.linalg.solve(A, b))
    except (np.linalg.LinAlgError, NumericalError, RuntimeError):
        return None
