"""When a relay system x' = Ax + Bu, y = Cx + Du, u_i = -sgn y_i (11.89) has one solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import BoolVector, as_array, as_matrix
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.parts import strongly_connected_parts
from pricing_core.lcs.system import LCS
from pricing_core.lcs.theorems import TOO_MANY_MODES, Finding, theorem_11_5, together
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS, transfer_minors
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.linalg.rational import RationalMatrix, rational_array


def theorem_11_6(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None = None) -> Finding:
    """Well-posed if G(s) = C (sI - A)^-1 B + D of the relay system itself is a P-matrix for all large s; exact.

    Returns
    -------
    Finding
        "holds" or "silent": the condition is sufficient only.

    Notes
    -----
    Cost: 2**k principal minors for each strongly connected part of k <= 12 relays.
    Source: theorem 11.6; Lootsma, van der Schaft, Camlibel 1999.

    Examples
    --------
    Filippov's example (11.68), x' = -B sgn x:

    >>> zero, one = np.zeros((2, 2)), np.eye(2)
    >>> theorem_11_6(zero, [[1, -2], [2, 1]], one).status
    'holds'
    >>> theorem_11_6(zero, [[1, -3], [-2, 1]], one).status
    'silent'
    """
    parts = [part for part in strongly_connected_parts(LCS(A, B, C, D)) if part.pairs]
    if any(len(part.pairs) > LARGEST_PAIRS for part in parts):
        return Finding("silent", TOO_MANY_MODES)
    return together([theorem_11_5(transfer_minors(part.system)) for part in parts])


def has_guaranteed_direction(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None, x: ArrayLike
) -> BoolVector:
    """Tell for each x whether a criterion guarantees one continuation of (11.89) from it; exact.

    Off the surfaces y_i = 0 there is nothing to choose. On one of them the criterion is Filippov's: the vector
    field on at least one side points across it, c_i x' < 0 where y_i > 0 or c_i x' > 0 where y_i < 0. On several
    of them, J, the others keep their signs, and theorem 11.6 is applied to G_JJ. False means no guarantee.

    Parameters
    ----------
    A, B, C : array_like, shapes (n, n), (n, k), (k, n)
    D : array_like or None
        Zero: y = Cx alone places the surfaces.
    x : array_like, shape (n,) or (m, n)

    Returns
    -------
    array of bool, shape () or (m,)

    Raises
    ------
    InvalidInputError
        D is not zero, or more than 12 surfaces meet in an x.

    Notes
    -----
    Source: Filippov 1988, section 2.10.

    Examples
    --------
    x' = sgn x leaves 0 to both sides, x' = -sgn x stays there:

    >>> bool(has_guaranteed_direction([[0]], [[-1]], [[1]], None, [0])), bool(
    ...     has_guaranteed_direction([[0]], [[1]], [[1]], None, [0]))
    (False, True)
    """
    system = LCS(A, B, C, D)
    if system.D.any():
        raise InvalidInputError("D", D, "zero: Filippov's criterion needs surfaces y = Cx")
    given = as_array("x", x)
    states = np.atleast_2d(given)
    as_matrix("x", states, (len(states), system.shape[0]))
    answers = np.array([_is_guaranteed(system, rational_array(state)) for state in states])
    return answers if given.ndim == 2 else np.asarray(answers[0])


def _is_guaranteed(system: LCS, x: RationalMatrix) -> bool:
    A, B, C, _ = (rational_array(matrix) for matrix in system.given)
    y = C @ x
    surfaces = np.flatnonzero(y == 0)
    if surfaces.size == 0:
        return True
    u = np.array([0 if value == 0 else (-1 if value > 0 else 1) for value in y], dtype=object)
    if surfaces.size == 1:
        i = surfaces[0]
        middle, turn = C[i] @ (A @ x + B @ u), C[i] @ B[:, i]
        return bool(middle - turn < 0 or middle + turn > 0)
    chosen = surfaces.tolist()
    if len(chosen) > LARGEST_PAIRS:
        raise InvalidInputError("x", x, f"on at most {LARGEST_PAIRS} surfaces")
    part = LCS(system.given[0], system.given[1][:, chosen], system.given[2][chosen])
    return all_positive(transfer_minors(part))
