"""Whether the state of a system has at most one continuation, by the matrix of its implicit steps."""

import numpy as np

from pricing_core.errors import NumericalError
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.linalg.matrix_classes import is_p_matrix

LARGE = (1e3, 1e6)  # real s, in the form's units
LARGEST_P = 10  # pairs up to which the P property is looked at
ROUNDING = 1e-12


def has_unique_steps(form: AutonomousForm) -> bool:
    """Tell whether G(s) at large real s is a P-matrix, or positive semidefinite as in a passive system.

    The first makes states and multipliers unique (Theorem 11.5), the second the states alone (11.2.1). This is a
    quick test in floating point that spares the search for further continuations; `well_posedness` proves.
    """
    A, B, C, D = form.system.A, form.system.B, form.system.C, form.system.D
    matrices = [D + C @ np.linalg.solve(s * np.eye(A.shape[0]) - A, B) for s in LARGE]
    return all(_is_monotone(G) for G in matrices) or all(_is_p(G) for G in matrices)


def _is_monotone(G: np.ndarray) -> bool:
    least = np.linalg.eigvalsh(0.5 * (G + G.T)).min(initial=0.0)
    return bool(least >= -ROUNDING * np.abs(G).max(initial=0.0))


def _is_p(G: np.ndarray) -> bool:
    if G.shape[0] > LARGEST_P:
        return False
    try:
        return is_p_matrix(G)
    except NumericalError:
        return False
