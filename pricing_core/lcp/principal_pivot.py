"""The principal pivot transform: exchange z_i and w_i on a set of indices."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.errors import NumericalError
from pricing_core.lcp.problem import LCP


def principal_pivot(problem: LCP, pivot_set: BoolVector) -> LCP:
    """Return the equivalent LCP in which z_i and w_i have changed places for i in the pivot set.

    With a the pivot set and b the rest, solving w_a = M_aa z_a + M_ab z_b + q_a for z_a gives

        M' = [[M_aa^-1, -M_aa^-1 M_ab], [M_ba M_aa^-1, M_bb - M_ba M_aa^-1 M_ab]],
        q' = (-M_aa^-1 q_a, q_b - M_ba M_aa^-1 q_a).

    Parameters
    ----------
    problem : LCP
        Made dense.
    pivot_set : boolean array, shape (n,)

    Raises
    ------
    NumericalError
        M_aa is singular.

    Notes
    -----
    Source: Cottle, Pang, Stone 1992, section 2.3. Cost: O(n**3).

    Examples
    --------
    >>> principal_pivot(LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0]), np.array([True, False])).M
    array([[ 0.5, -0.5],
           [ 0.5,  1.5]])
    """
    M, q, n = problem.dense(), problem.q, problem.size
    # w - M z = q; solve for the variables of the set {z_a, w_b} in terms of {w_a, z_b} and 1.
    identity = np.eye(n)
    solved = np.where(pivot_set, -M, identity)
    free = np.where(pivot_set, identity, -M)
    try:
        table = np.linalg.solve(solved, np.column_stack([-free, q]))
    except np.linalg.LinAlgError:
        raise NumericalError("the pivot set has a singular principal submatrix: choose another") from None
    return LCP(table[:, :n], table[:, n])
