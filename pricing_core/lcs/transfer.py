"""The transfer matrix G(s) = C (sI - A)^-1 B + D: its relative degree over the modes."""

from __future__ import annotations

import itertools
import math

import numpy as np

from pricing_core.arrays import Matrix, check_type
from pricing_core.lcs.exact_degree import LARGEST_EXACT, exact_degree
from pricing_core.lcs.system import LCS
from pricing_core.linalg.matrix_classes import is_h_plus_matrix, is_m_matrix, is_positive_definite

LARGEST_COMPLETE = 10  # pairs up to which all 2**k modes are examined
SINGULAR = 1e-11  # reciprocal condition below which G_II counts as singular


def relative_degree(system: LCS) -> int:
    """Return the largest power of s in G_II(s)^-1 over the modes I, at least 0.

    Time stepping converges up to 2: the multiplier of a mode of relative degree 3 contains delta', which no
    step of size h can hold. Modes with singular G_II say nothing and are passed over.

    For k <= 6 and n <= 12 every G_II is inverted in exact arithmetic (unless its numbers grow too long, see
    `exact_degree`), and no scaling of the data can mislead. In larger systems the power is read off the
    growth of G_II^-1 between two large real s, in floating point: there a leading coefficient that is tiny
    beside the others passes for zero, and a G_II of condition above 1e11 for singular. For k > 10 a matrix D,
    or CB where D = 0, that is positive definite, an M-matrix or an H-matrix with positive diagonal settles it
    (0, or 1: every G_II is then dominated by that term); otherwise only modes of one or two indices and the
    full mode are examined.

    Parameters
    ----------
    system : LCS

    Examples
    --------
    The triple integrator y = x1, x3' = u has G = 1/s**3:

    >>> A = [[0, 1, 0], [0, 0, 1], [0, 0, 0]]
    >>> relative_degree(LCS(A, [[0], [0], [1]], [[1, 0, 0]]))
    3

    A feedthrough of 1e-3 is a feedthrough, however large CB:

    >>> relative_degree(LCS([[0]], [[1e6]], [[1]], [[1e-3]]))
    0
    """
    check_type("system", system, LCS)
    k = system.shape[1]
    if k <= LARGEST_EXACT and (degree := exact_degree(system, _modes(k))) is not None:
        return degree
    if k > LARGEST_COMPLETE:
        if _every_minor_is_positive(system.D):
            return 0
        if not system.D.any() and _every_minor_is_positive(system.C @ system.B):
            return 1
    scale = max(1.0, float(np.linalg.norm(system.A, 2)))
    near, far = (_transfer(system, factor * scale) for factor in (1e2, 1e4))
    degrees = (_growth(near[np.ix_(mode, mode)], far[np.ix_(mode, mode)]) for mode in _modes(k))
    return max((degree for degree in degrees if degree is not None), default=0)


def _transfer(system: LCS, s: float) -> Matrix:
    n = system.shape[0]
    return np.asarray(system.C @ np.linalg.solve(s * np.eye(n) - system.A, system.B) + system.D)


def _modes(k: int) -> list[tuple[int, ...]]:
    sizes = range(1, k + 1) if k <= LARGEST_COMPLETE else (1, 2, k)
    return [mode for size in sizes for mode in itertools.combinations(range(k), size)]


def _growth(near: Matrix, far: Matrix) -> int | None:
    """Return the power of s in G_II^-1 from its values at s and 100 s, None where G_II is singular."""
    norms = []
    for G in (near, far):
        equilibrated, rows, columns = _equilibrate(G)
        if rows is None or columns is None or np.linalg.cond(equilibrated) > 1.0 / SINGULAR:
            return None
        inverse = np.linalg.inv(equilibrated) * rows[None, :] * columns[:, None]
        norms.append(float(np.max(np.abs(inverse))))
    return max(0, round(math.log(norms[1] / norms[0]) / math.log(100.0)))


def _equilibrate(G: Matrix) -> tuple[Matrix, Matrix | None, Matrix | None]:
    """Scale rows, then columns, to largest entry 1: entries of different powers of s become comparable."""
    largest = np.max(np.abs(G), axis=1)
    if not largest.all():
        return G, None, None
    rows = 1.0 / largest
    scaled = G * rows[:, None]
    largest_left = np.max(np.abs(scaled), axis=0)
    if not largest_left.all():
        return G, None, None
    columns = 1.0 / largest_left
    return scaled * columns[None, :], rows, columns


def _every_minor_is_positive(M: Matrix) -> bool:
    return is_positive_definite(M) or is_m_matrix(M) or is_h_plus_matrix(M)
