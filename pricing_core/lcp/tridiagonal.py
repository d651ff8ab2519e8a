"""O(n) solvers for tridiagonal M-matrices: Brennan-Schwartz, the double sweep, and one for any contact set."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import numpy as np

from pricing_core import kernel
from pricing_core.arrays import BoolVector, Vector, check_choice, check_type
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, verified
from pricing_core.linalg.tridiagonal import Tridiagonal

# Elimination in a tridiagonal M-matrix without pivoting has a componentwise backward error of a few units of
# rounding (Higham 2002, theorem 9.12), so a true solution stays far below this scaled residual.
VALID = 1e-12
MENDING_SYSTEMS = 30  # of policy iteration from the contact set that one pass has found; one or two are usual


def solve_brennan_schwartz(problem: LCP, *, contact: Literal["first", "last"] = "first") -> LCPSolution:
    """Solve a tridiagonal M-matrix LCP whose contact set {z = 0} is one run of indices at one end.

    Eliminate from the other end towards the contact, then substitute back with max(0, .). The answer is
    checked: where the contact set is of another kind this raises and returns nothing.

    Parameters
    ----------
    problem : LCP
        M a Tridiagonal, or any matrix that is zero outside the three diagonals.
    contact : {"first", "last"}
        The end, index 0 or n - 1, which the contact set touches; it may be empty.

    Raises
    ------
    NumericalError
        The complementarity residual says that the contact set is not of this kind, or M is no M-matrix.
    InvalidInputError
        M is not tridiagonal.

    Notes
    -----
    Source: Brennan and Schwartz 1977; Jaillet, Lamberton, Lapeyre 1990 (when it is right). Cost: O(n).

    Examples
    --------
    >>> problem = LCP(Tridiagonal([-1.0], [2.0, 2.0], [-1.0]), [3.0, -2.0])
    >>> solve_brennan_schwartz(problem, contact="first").z
    array([0., 1.])
    """
    check_type("problem", problem, LCP)
    check_choice("contact", contact, ("first", "last"))
    z = _one_sweep(problem, contact == "first")
    remedy = f"the contact set is not one run at the {contact} end, or M is no M-matrix; use the double sweep"
    return verified(problem, z, 1, "brennan-schwartz", VALID, remedy)


def solve_double_sweep(problem: LCP) -> LCPSolution:
    """Solve a tridiagonal M-matrix LCP whose contact set {z = 0} is one run of indices, wherever it lies.

    z = max(z_A, z_B): A eliminates from the last row and substitutes from the first, B is its mirror image.

    Why this is the solution z*, with w* = M z* + q. In A, elimination turns row i into d_i z_i + lower_{i-1}
    z_{i-1} + c_i. Let e_i be the value of that for z*. Row i gets the multiple -m_i = -upper_i / d_{i+1} of
    row i + 1, so e_i = w*_i - m_i e_{i+1}; off-diagonals are <= 0 and pivots > 0, so m_i <= 0, and e_i >= 0
    by induction from the last row. Substitution sets the same expressions to zero: with a the iterate of A,

        z*_i = (e_i - c_i - lower_{i-1} z*_{i-1}) / d_i >= (-c_i - lower_{i-1} a_{i-1}) / d_i

    as long as a_{i-1} <= z*_{i-1}, since lower <= 0. With z* >= 0 this gives 0 <= a <= z* by induction: A is
    a lower bound, and so is B. Now let z* = 0 on one run of indices. On the run the bounds meet: a = z* = 0.
    Behind it all w*_j are zero, hence e_i = 0, the inequality above is an equality, and a stays exact. So A
    is right from the first index of the run on, B in the same way up to its last index, and the maximum is
    right everywhere. Without contact all e_i vanish and A is right throughout. With two or more runs the
    maximum is a lower bound only.

    Parameters
    ----------
    problem : LCP
        M a Tridiagonal, or any matrix that is zero outside the three diagonals.

    Raises
    ------
    NumericalError
        The complementarity residual says that the contact set has several runs, or M is no M-matrix.
    InvalidInputError
        M is not tridiagonal.

    Notes
    -----
    Cost: O(n). Checked by the residual as `solve_brennan_schwartz` is.

    Examples
    --------
    >>> problem = LCP(Tridiagonal([-1.0, -1.0], [2.0, 2.0, 2.0], [-1.0, -1.0]), [-2.0, 5.0, -4.0])
    >>> solve_double_sweep(problem).z
    array([1., 0., 2.])
    """
    check_type("problem", problem, LCP)
    z = np.maximum(_one_sweep(problem, True), _one_sweep(problem, False))
    remedy = "the contact set has more than one run of indices, or M is no M-matrix; use policy iteration"
    return verified(problem, z, 2, "double-sweep", VALID, remedy)


def solve_tridiagonal_m_matrix(problem: LCP, *, time_limit: float | None = None) -> LCPSolution:
    """Solve a tridiagonal M-matrix LCP with any number of contact runs in O(n).

    One pass finds the contact set (`kernel.growing_basic_set`); the solver that is made for such a set answers:
    Brennan-Schwartz, the double sweep, or policy iteration from that set, which mends what rounding did to it.

    Parameters
    ----------
    problem : LCP
        M a Tridiagonal, or any matrix that is zero outside the three diagonals. For other matrices than M-matrices
        policy iteration may or may not end with a solution.
    time_limit : float, optional
        Seconds.

    Raises
    ------
    NumericalError, IterationLimitError
        As `solve_policy_iteration`.
    InvalidInputError
        M is not tridiagonal.

    Examples
    --------
    >>> problem = LCP(Tridiagonal([-1.0] * 4, [2.0] * 5, [-1.0] * 4), [4.0, 0.0, -3.0, 5.0, -2.0])
    >>> solve_tridiagonal_m_matrix(problem).z
    array([0., 1., 2., 0., 1.])
    """
    check_type("problem", problem, LCP)
    banded = _tridiagonal_problem(problem)
    T = banded.M
    assert isinstance(T, Tridiagonal)
    try:
        basic_set = kernel.growing_basic_set(T.lower, T.diagonal, T.upper, problem.q)
    except ZeroDivisionError:
        basic_set = problem.q < 0.0
    try:
        return _direct(banded, basic_set)
    except NumericalError:
        pass
    try:
        return solve_policy_iteration(
            banded, start=basic_set, max_iterations=MENDING_SYSTEMS, time_limit=time_limit
        )
    except NumericalError:  # rounding may move rows where z and w vanish for ever
        with suppress(NumericalError):
            return _at(banded, basic_set)
    return solve_policy_iteration(banded, time_limit=time_limit)


def _direct(problem: LCP, basic_set: BoolVector) -> LCPSolution:
    """Solve by the method that is exact for this contact set."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], ~basic_set, [False]]).astype(np.int8)))
    if ends.size > 2:
        raise NumericalError("the contact set has several runs")
    if ends.size == 0 or ends[0] == 0:
        return solve_brennan_schwartz(problem)
    return (
        solve_brennan_schwartz(problem, contact="last")
        if ends[1] == problem.size
        else solve_double_sweep(problem)
    )


def _at(problem: LCP, basic_set: BoolVector) -> LCPSolution:
    """Return the point of a basic set, which is what policy iteration from there begins with."""
    z = basic_point(problem, basic_set)
    return verified(problem, z, 1, "policy-iteration", DEFAULT_TOLERANCE, "use Lemke: M may be no M-matrix")


def _tridiagonal_problem(problem: LCP) -> LCP:
    T = as_tridiagonal(problem)
    if T is None:
        raise InvalidInputError("M", f"a matrix of order {problem.size}", "tridiagonal, and not empty")
    return problem if T is problem.M else LCP(T, problem.q)


def as_tridiagonal(problem: LCP) -> Tridiagonal | None:
    """Return M as a Tridiagonal, or None where it has an entry outside the three diagonals or is empty."""
    M = problem.M
    if isinstance(M, Tridiagonal):
        return M
    if problem.size == 0:
        return None
    if isinstance(M, np.ndarray) and (M[0, 2:].any() or M[2:, 0].any()):
        return None  # seen without a look at all entries
    rows, columns = M.nonzero()
    if (np.abs(rows - columns) > 1).any():
        return None
    return Tridiagonal(*(np.asarray(M.diagonal(k)) for k in (-1, 0, 1)))


def _one_sweep(problem: LCP, contact_first: bool) -> Vector:
    T = _tridiagonal_problem(problem).M
    assert isinstance(T, Tridiagonal)
    try:
        return np.asarray(kernel.brennan_schwartz(T.lower, T.diagonal, T.upper, problem.q, contact_first))
    except ZeroDivisionError:
        raise NumericalError("a pivot is zero: M is no M-matrix; use Lemke") from None
