"""The transient: from which power on A^(k+c) = c lambda + A^k."""

import numpy as np

from pricing_core.errors import InvalidInputError, IterationLimitError, Told
from pricing_core.max_plus.algebra import identity, multiply, power
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.critical import critical_graph
from pricing_core.max_plus.matrices import EPSILON, Numbers, as_square, dense, is_exact
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
    Floats are compared to what rounding may do to k sums; `exact` data need no such guess.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.109 (existence).

    Examples
    --------
    >>> transient([[2.0, 5.0], [3.0, 3.0]])
    2
    """
    matrix = dense(as_square("A", A, top=False))
    critical = critical_graph(matrix)
    solution = mean_of_circuits(arcs_of(matrix))
    others = solution.ratio[solution.ratio != EPSILON]
    if others.size and others.max() - others.min() > 2 * solution.tolerance:
        raise InvalidInputError(
            "A",
            Told(f"circuit means from {others.min()} to {others.max()}"),
            "a matrix whose classes share one mean",
        )
    normal = matrix if critical.eigenvalue == EPSILON else matrix - critical.eigenvalue
    return _first_periodic_power(normal, critical.cyclicity, max_steps)


def _first_periodic_power(A: Numbers, period: int, max_steps: int) -> int:
    ahead = dense(power(A, period))
    squares = [A]  # A^(2^i)
    if _is_periodic(dense(identity(len(A), like=A)), ahead, 1):
        return 0
    while not _is_periodic(squares[-1], ahead, 2 ** (len(squares) - 1)):
        if 2 ** (len(squares) - 1) > max_steps:
            raise IterationLimitError(f"the transient is longer than {max_steps}: raise max_steps")
        squares.append(dense(multiply(squares[-1], squares[-1])))
    # The largest power that is not yet periodic, bit by bit.
    reached, count = dense(identity(len(A), like=A)), 0
    for bit in reversed(range(len(squares) - 1)):
        trial = dense(multiply(reached, squares[bit]))
        if not _is_periodic(trial, ahead, count + 2**bit):
            reached, count = trial, count + 2**bit
    if count + 1 > max_steps:
        raise IterationLimitError(f"the transient is longer than {max_steps}: raise max_steps")
    return count + 1


def _is_periodic(this: Numbers, ahead: Numbers, k: int) -> bool:
    """Return whether A^(k+c) = A^k, for the A with largest mean 0."""
    later = dense(multiply(this, ahead))
    if is_exact(this):
        return bool((later == this).all())
    same = (later == EPSILON) == (this == EPSILON)
    if not same.all():
        return False
    finite = this != EPSILON
    largest = max(float(np.abs(part[part != EPSILON]).max(initial=0.0)) for part in (this, ahead))
    allowed = 8.0 * (k + len(this)) * largest * np.finfo(np.float64).eps
    return bool((np.abs(later[finite] - this[finite]) <= allowed).all())
