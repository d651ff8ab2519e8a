"""Whether the state of a system has at most one continuation, by the matrix of its implicit steps."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import Matrix
from pricing_core.errors import NumericalError
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.linalg.matrix_classes import is_p_matrix

LARGE = (1e3, 1e6)  # real s, in the form's units
LARGEST_P = 10  # pairs up to which the P property is looked at
ROUNDING = 1e-12
# Share of B below which a product with it is zero: vectors of a kernel are known less closely than its values.
UNMOVED = 1e-6


def has_unique_steps(form: AutonomousForm) -> bool:
    """Tell whether G(s) at large real s is a P-matrix, or such that u^T G u >= 0, with u^T G u = 0 only where B u = 0.

    The first makes states and multipliers unique (Theorem 11.5), the second the states alone: it is so in a passive
    system with a positive definite storage function (11.2.1), but not where u moves states that y does not see. This
    is a quick test in floating point that spares the search for further continuations; `well_posedness` proves.
    """
    A, B, C, D = form.system.A, form.system.B, form.system.C, form.system.D
    matrices = [D + C @ np.linalg.solve(s * np.eye(A.shape[0]) - A, B) for s in LARGE]
    return all(_is_monotone(G, B) for G in matrices) or all(_is_p(G) for G in matrices)


def _is_monotone(G: Matrix, B: Matrix) -> bool:
    values, vectors = np.linalg.eigh(0.5 * (G + G.T))
    rounding = ROUNDING * float(np.abs(G).max(initial=0.0))
    moved = B @ vectors[:, values <= rounding]
    size = float(np.abs(B).max(initial=0.0))
    return bool((values >= -rounding).all() and (np.abs(moved) <= UNMOVED * size).all())


def _is_p(G: Matrix) -> bool:
    if G.shape[0] > LARGEST_P:
        return False
    try:
        return is_p_matrix(G)
    except NumericalError:
        return False
