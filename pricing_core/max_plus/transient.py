"""The transient: from which power on A^(k+c) = c lambda + A^k."""

from __future__ import annotations

from functools import partial

import numpy as np

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, IterationLimitError, Told
from pricing_core.max_plus.algebra import identity, multiply, power
from pricing_core.max_plus.arcs import Arcs, arcs_of
from pricing_core.max_plus.critical import critical_graph_of
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.matrices import EPSILON, Numbers, as_square, dense, is_exact, zero_like
from pricing_core.max_plus.normal_form import normal_form
from pricing_core.max_plus.scalars import UNIT
from pricing_core.max_plus.spectrum import mean_of_circuits


def transient(A: object, *, max_steps: int = 1_000_000) -> int:
    """Return the least K >= 0 with A^(k+c) = c lambda + A^k for all k >= K; c is the cyclicity.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Every circuit lies in a class of the largest mean: an irreducible A is enough.
    max_steps : int
        Give up beyond.

    Raises
    ------
    InvalidInputError
        Classes have different means, so that no such K exists; or A is not square, is empty, or an
        entry is NaN or +inf.
    IterationLimitError
        K is larger than `max_steps`; two circuits of nearly the same mean take long.

    Notes
    -----
    Equality once is equality for ever, so that K is found by doubling and halving: O(n**3 log K).
    It is found for P (A - lambda) P^-1, whose entries are <= 0 and zero on critical circuits: its powers keep
    their relative accuracy, and floats are compared to that. `exact` data need no such guess.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.109 (existence).

    Examples
    --------
    >>> transient([[2.0, 5.0], [3.0, 3.0]])
    2
    """
    max_steps = as_whole_number("max_steps", max_steps, 0)
    graph = arcs_of(as_square("A", A, top=False))
    solution = mean_of_circuits(graph)
    others = solution.ratio != EPSILON
    if others.any():
        lower, upper = solution.ratio[others] - solution.error[others], solution.ratio[others]
        if lower.max() > (upper + solution.error[others]).min():
            raise InvalidInputError(
                "A",
                Told(f"circuit means from {upper.min()} to {upper.max()}"),
                "a matrix whose classes share one mean",
            )
    critical = critical_graph_of(graph, solution)
    return _first_periodic_power(*_normal_matrix(graph, solution), critical.cyclicity, max_steps)


def _normal_matrix(graph: Arcs, solution: HowardSolution) -> tuple[Numbers, Numbers]:
    """Return P (A - lambda) P^-1 with entries <= 0, and what rounding may have made of each of its powers.

    Entries that rounding may have made of zero are zero: on critical circuits nothing is added up.
    """
    n, largest, zero = graph.size, solution.ratio.max(), zero_like(graph.weight)
    rate = np.full(n, zero if largest == EPSILON else largest)
    normal, p = normal_form(graph, solution, rate, np.full(graph.head.size, True))
    weight = normal.weight.copy()
    weight[weight >= -solution.slack] = zero
    matrix = np.full((n, n), EPSILON, dtype=graph.weight.dtype)
    matrix[normal.head, normal.tail] = weight
    if is_exact(matrix):
        return matrix, np.full((n, n), zero)
    size = solution.error.max() + n * UNIT * np.abs(p)
    return matrix, size[:, None] + size


def _first_periodic_power(A: Numbers, noise: Numbers, period: int, max_steps: int) -> int:
    ahead = dense(power(A, period))
    squares = [A]  # A^(2^i)
    periodic = partial(_is_periodic, ahead, noise)
    if periodic(dense(identity(len(A), like=A)), 0):
        return 0
    while not periodic(squares[-1], len(squares)):
        if 2 ** (len(squares) - 1) > max_steps:
            raise IterationLimitError(f"the transient is longer than {max_steps}: raise max_steps")
        squares.append(dense(multiply(squares[-1], squares[-1])))
    # The largest power that is not yet periodic, bit by bit.
    reached, count = dense(identity(len(A), like=A)), 0
    for bit in reversed(range(len(squares) - 1)):
        trial = dense(multiply(reached, squares[bit]))
        if not periodic(trial, len(squares)):
            reached, count = trial, count + 2**bit
    if count + 1 > max_steps:
        raise IterationLimitError(f"the transient is longer than {max_steps}: raise max_steps")
    return count + 1


def _is_periodic(ahead: Numbers, noise: Numbers, this: Numbers, doublings: int) -> bool:
    """Return whether A^(k+c) = A^k, for an A with entries <= 0: sums of one sign keep their relative accuracy."""
    later = dense(multiply(this, ahead))
    if is_exact(this):
        return bool((later == this).all())
    if not np.array_equal(later == EPSILON, this == EPSILON):
        return False
    finite = this != EPSILON
    allowed = (2 * doublings + 4) * UNIT * np.abs(this[finite]) + noise[finite]
    return bool((np.abs(later[finite] - this[finite]) <= allowed).all())
