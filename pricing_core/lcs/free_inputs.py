"""Whether inputs that no output sees move the state: modes with a unique u then do not tell all continuations."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from pricing_core.arrays import IndexSet, Matrix
from pricing_core.lcp.linear_programme import minimise
from pricing_core.lcs.autonomous import AutonomousForm

LARGE = 1e3  # real s, in the form's units
UNSEEN = 1e-10  # Share of the terms of G below which an output does not see an input.
MOVES = 1e-6  # Share of the largest entry of B above which an input moves the state.


def free_input_moves_state(form: AutonomousForm, mode: IndexSet, held: IndexSet, rising: IndexSet) -> bool:
    """Tell whether some d >= 0 may be added to u in the mode with y_I = 0 and moves x.

    Parameters
    ----------
    mode : tuple of int
        I, in which u is not unique.
    held : tuple of int
        The i in I with u_i > 0: there d_i may have either sign.
    rising : tuple of int
        The i outside of I with y_i = 0, which must not fall.

    Notes
    -----
    d is looked for in the kernel of G_II at a large real s: G_II d = 0, d_i >= 0 for i in I but not held, G_i d >= 0
    for rising i, B d != 0. Cost: a singular value decomposition, and where it has a kernel some linear programmes.

    Examples
    --------
    x' = u, y = 0: any u >= 0.

    >>> from pricing_core.lcs.autonomous import autonomous_form
    >>> from pricing_core.lcs.system import LCS
    >>> free_input_moves_state(autonomous_form(LCS([[0]], [[1]], [[0]])), (0,), (), ())
    True
    """
    A, B, C, D = form.system.A, form.system.B, form.system.C, form.system.D
    resolved = np.linalg.solve(LARGE * np.eye(A.shape[0]) - A, B)
    G, sizes = D + C @ resolved, np.abs(D) + np.abs(C) @ np.abs(resolved)
    index = list(mode)
    scale = np.maximum(sizes[index].max(axis=1, initial=0.0), np.finfo(float).tiny)
    kernel = null_space(G[np.ix_(index, index)] / scale[:, None], rcond=UNSEEN)
    bounded = [position for position, i in enumerate(mode) if i not in held]
    cone = np.vstack([kernel[bounded], G[np.ix_(list(rising), index)] @ kernel])
    moved = B[:, index] @ kernel
    moves = np.abs(moved).max(axis=1, initial=0.0) > MOVES * np.abs(B).max(initial=0.0)
    return _reaches(cone, moved[moves])


def _reaches(cone: Matrix, rows: Matrix) -> bool:
    """Tell whether cone c >= 0 has a solution with rows c != 0."""
    lengths = np.linalg.norm(cone, axis=1, keepdims=True)
    limits = -cone / np.where(lengths > UNSEEN, lengths, np.inf)
    for row in (*rows, *-rows):  # c = p - q, 0 <= p, q <= 1
        split = np.concatenate([-row, row]) / np.abs(row).max()
        found = minimise(split, np.hstack([limits, -limits]), np.zeros(len(limits)), np.ones(split.size))
        if found is not None and split @ found < -MOVES:
            return True
    return False
