"""Murty's least-index principal pivoting: slow in the worst case, finite for every P-matrix."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector, Vector, as_whole_number, check_type
from pricing_core.errors import IterationLimitError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, scaled_parts, verified
from pricing_core.lcp.time_limit import TimeLimit

VIOLATION = 1e-13  # scaled: smaller negative numbers are rounding


def solve_murty(
    problem: LCP, *, max_pivots: int | None = None, time_limit: float | None = None
) -> LCPSolution:
    """Solve an LCP with a P-matrix by single principal pivots on the first violated index.

    Start from z = 0. While some z_i < 0 with i basic or w_i < 0 with i not basic, move the first such i into
    or out of the basic set.

    Parameters
    ----------
    problem : LCP
        M a P-matrix; for other matrices the method may stop on a singular submatrix or go round in circles.
    max_pivots : int, optional
        Default 1000 + 50 n. A pivot costs one factorisation; there may be 2**n - 1 of them.
    time_limit : float, optional
        Seconds.

    Returns
    -------
    LCPSolution
        `iterations` counts the pivots.

    Raises
    ------
    IterationLimitError
        `max_pivots` or `time_limit` were not enough.
    NumericalError
        A principal submatrix is singular: M is no P-matrix.

    Notes
    -----
    Source: Murty 1974, Note on a Bard-type scheme; Murty 1988, section 4.1.

    Examples
    --------
    >>> solution = solve_murty(LCP([[1.0, 2.0, 0.0], [0.0, 1.0, 2.0], [2.0, 0.0, 1.0]], [-3.0, -3.0, -3.0]))
    >>> solution.z
    array([1., 1., 1.])
    """
    check_type("problem", problem, LCP)
    limit = 1000 + 50 * problem.size if max_pivots is None else as_whole_number("max_pivots", max_pivots, 0)
    clock = TimeLimit(time_limit)
    basic_set = np.zeros(problem.size, dtype=np.bool_)
    for pivots in range(limit + 1):
        clock.check("least-index pivoting")
        z = basic_point(problem, basic_set)
        violated = np.flatnonzero(_violations(problem, z, basic_set))
        if violated.size == 0:
            return verified(problem, z, pivots, "murty", DEFAULT_TOLERANCE, "use Lemke: M may be no P-matrix")
        basic_set[violated[0]] ^= True
    raise IterationLimitError(
        f"least-index pivoting did not end within {limit} pivots: "
        "raise max_pivots if M is a P-matrix, else use Lemke"
    )


def _violations(problem: LCP, z: Vector, basic_set: BoolVector) -> BoolVector:
    weight, slack = scaled_parts(problem, z)
    return np.where(basic_set, weight, slack) < -VIOLATION
