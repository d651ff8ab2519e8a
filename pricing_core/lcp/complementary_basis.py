"""Which unknown of each pair the equations M w = N z + q determine."""

from __future__ import annotations

import numpy as np

from pricing_core.arrays import BoolVector, Matrix
from pricing_core.errors import NumericalError

# Smallest singular value, for columns of length 1, that counts in the rank.
RANK = 1e-10


def complementary_basis(M: Matrix, N: Matrix) -> BoolVector:
    """Return for each pair whether z_i, rather than w_i, is among n unknowns that the equations determine.

    The columns, M_i or N_i for each i, are chosen from the last pair to the first, M_i where both are possible.

    Raises
    ------
    NumericalError
        Every such matrix of n columns is singular, to within 1e-10.

    Notes
    -----
    Cost: n rank decisions as a rule; a choice that proves wrong later is taken back.

    Examples
    --------
    >>> complementary_basis(np.array([[1.0, -1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]]))
    array([ True, False])
    """
    n = len(M)
    pairs = _unit_columns(M), _unit_columns(N)
    waiting: list[tuple[bool, ...]] = [()]  # the choices for the last pairs
    while waiting:
        chosen = waiting.pop()
        first = n - len(chosen)
        columns = [pairs[traded][:, first + i] for i, traded in enumerate(chosen)]
        fixed = np.column_stack([*columns, np.zeros((n, 0))])
        everything = np.hstack([fixed, pairs[0][:, :first], pairs[1][:, :first]])
        if _rank(fixed) < len(chosen) or _rank(everything) < n:
            continue
        if first == 0:
            return np.array(chosen, dtype=np.bool_)
        waiting += [(True, *chosen), (False, *chosen)]
    raise NumericalError(
        "every choice of one column of each pair gives a singular matrix: the equations of this horizontal "
        "problem do not determine as many unknowns as there are pairs"
    )


def exchanged(M: Matrix, N: Matrix, traded: BoolVector, right: Matrix) -> Matrix:
    """Return [P, R] with s = P m + R r for M w = N z + right r.

    s collects w_i, or z_i where traded, and m the others, shape (n, n + columns of `right`).

    Examples
    --------
    >>> exchanged(np.eye(1), np.array([[2.0]]), np.array([True]), np.array([[3.0]]))
    array([[ 0.5, -1.5]])
    """
    dependent, independent = np.where(traded, -N, M), np.where(traded, -M, N)
    return np.asarray(np.linalg.solve(dependent, np.hstack([independent, right]))) + 0.0


def _unit_columns(M: Matrix) -> Matrix:
    lengths = np.linalg.norm(M, axis=0)
    return np.asarray(M / np.where(lengths > 0.0, lengths, 1.0))


def _rank(columns: Matrix) -> int:
    return int(np.linalg.matrix_rank(columns, tol=RANK)) if columns.shape[1] else 0
