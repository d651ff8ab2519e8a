"""The vertical LCP, in which the minimum over several rows is zero, by Howard's policy iteration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_whole_number, check_type
from pricing_core.arrays import as_matrix as as_finite_matrix
from pricing_core.arrays import as_vector as as_finite_vector
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.lcp.basis import refined_solve
from pricing_core.lcp.policies import iterate_policies
from pricing_core.max_plus.arcs import Arcs, IntVector, arcs_of, first_of_runs
from pricing_core.max_plus.circuits import heaviest_circuit, named
from pricing_core.max_plus.matrices import as_floats, as_matrix, as_square, as_vector, dense
from pricing_core.max_plus.spectrum import mean_of_circuits

# Share of the numbers added in a row below which its residual is zero.
ROUNDING = 1e-13


@dataclass(frozen=True, slots=True, eq=False)
class VerticalLCP:
    """Find x with min over the rows k of group i of (N x + q)_k = 0, for every i = 0 ... n - 1.

    A row of the extended LCP of De Schutter and De Moor (1995): its slacks are >= 0, and their product is 0.
    An LCP is the case of two rows per group, z_i and (M z + q)_i; z = max(c_1, ..., c_m) that of the rows z - c_k.

    Parameters
    ----------
    N : array_like, shape (K, n)
    q : array_like, shape (K,)
    group : array_like of int, shape (K,)
        0 ... n - 1, each at least once.

    Raises
    ------
    InvalidInputError
        Shapes do not fit, an entry is not finite, or a group has no row.
    """

    N: Matrix  # (K, n)
    q: Vector  # (K,)
    group: IntVector  # (K,)

    def __init__(self, N: ArrayLike, q: ArrayLike, group: ArrayLike) -> None:
        matrix = as_finite_matrix("N", as_floats(dense(as_matrix("N", N, top=False))))
        groups = as_vector("group", group)
        if groups.shape != matrix.shape[:1] or (groups != np.floor(groups)).any():
            raise InvalidInputError("group", Told(f"shape {groups.shape}"), f"{len(matrix)} whole numbers")
        if not np.array_equal(np.unique(groups), np.arange(matrix.shape[1])):
            raise InvalidInputError("group", group, f"0 ... {matrix.shape[1] - 1}, each at least once")
        object.__setattr__(self, "N", matrix)
        object.__setattr__(self, "q", as_finite_vector("q", as_floats(as_vector("q", q)), len(matrix)))
        object.__setattr__(self, "group", groups.astype(np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class VerticalSolution:
    """A solution of a vertical LCP.

    Parameters
    ----------
    x : Vector, shape (n,)
    policy : IntVector, shape (n,)
        The row of each group that is zero at x.
    iterations : int
        How many linear systems it took.
    """

    x: Vector  # (n,)
    policy: IntVector  # (n,)
    iterations: int


def solve_vertical(problem: VerticalLCP, *, max_iterations: int = 200) -> VerticalSolution:
    """Solve a vertical LCP all of whose policies have M-matrices, starting from the first row of each group.

    Each iteration solves N_k x + q_k = 0 for one row k of each group, and then takes in each group the row with
    the least residual: this is Howard's iteration, and Newton's method on the minimum. See
    `pricing_core.max_plus.howard` for its other forms.

    Parameters
    ----------
    problem : VerticalLCP
    max_iterations : int

    Raises
    ------
    IterationLimitError
        `max_iterations` were not enough, as may happen for other matrices.
    NumericalError
        The matrix of a policy is singular.

    Notes
    -----
    Cost: one dense factorisation per iteration; a few are usual.
    Source: Howard 1960; Cottle, Dantzig 1970; Bokanowski, Maroso, Zidani 2009 (convergence).

    Examples
    --------
    x = max(1, 4, 2):

    >>> solve_vertical(VerticalLCP([[1.0], [1.0], [1.0]], [-1.0, -4.0, -2.0], [0, 0, 0])).x
    array([4.])
    """
    check_type("problem", problem, VerticalLCP)
    limit = as_whole_number("max_iterations", max_iterations, 1)
    first = np.array([np.flatnonzero(problem.group == i)[0] for i in range(problem.N.shape[1])])
    (policy, x), iterations = iterate_policies(
        partial(_evaluate, problem), partial(_improve, problem), first, limit=limit
    )
    return VerticalSolution(x, policy, iterations)


def fixed_point_problem(A: object, b: ArrayLike) -> VerticalLCP:
    """Return x = A x + b (max-plus) as a vertical LCP: the rows x_i - b_i and x_i - A_ij - x_j of group i.

    Its solution is `least_solution(A, b)`, if every circuit of A has a negative weight.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Finite or epsilon.
    b : array_like, shape (n,)
        Finite.

    Raises
    ------
    InvalidInputError
        Shapes do not fit, or b is not finite.
    NumericalError
        A circuit of A has a weight >= 0, and is named.

    Examples
    --------
    >>> solve_vertical(fixed_point_problem([[-1.0, 2.0], [-np.inf, -3.0]], [0.0, 5.0])).x
    array([7., 5.])
    """
    graph = arcs_of(as_square("A", A, top=False))
    stop = as_finite_vector("b", as_floats(as_vector("b", b)), graph.size)
    solution = mean_of_circuits(graph)
    if solution.ratio.max() >= 0:
        circuit = named(heaviest_circuit(graph, solution))
        raise NumericalError(
            f"the circuit {circuit} of A has a weight >= 0: its equations have many solutions or none; "
            "see least_solution"
        )
    arcs = graph.only(graph.head != graph.tail)  # x_i >= A_ii + x_i says nothing
    return VerticalLCP(
        np.vstack([np.eye(graph.size), _differences(arcs)]),
        np.concatenate([-stop, -arcs.weight.astype(np.float64)]),
        np.concatenate([np.arange(graph.size), arcs.head]),
    )


def _differences(arcs: Arcs) -> Matrix:
    rows = np.zeros((arcs.head.size, arcs.size))
    each = np.arange(arcs.head.size)
    rows[each, arcs.head] = 1.0
    rows[each, arcs.tail] = -1.0
    return rows


def _evaluate(problem: VerticalLCP, policy: IntVector) -> tuple[IntVector, Vector]:
    return policy, refined_solve(problem.N[policy], -problem.q[policy])


def _improve(problem: VerticalLCP, value: tuple[IntVector, Vector]) -> IntVector | None:
    policy, x = value
    residual = problem.N @ x + problem.q
    size = np.abs(problem.N) @ np.abs(x) + np.abs(problem.q)
    order = np.lexsort((residual, problem.group))
    least = order[first_of_runs(problem.group[order])]
    missed = np.abs(residual[policy])  # zero but for rounding, which is no gain
    better = residual[least] < -(ROUNDING * size[least] + 2.0 * missed)
    return np.where(better, least, policy) if better.any() else None
