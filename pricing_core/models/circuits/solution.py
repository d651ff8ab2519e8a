"""The completed equations solved: states and unknowns as functions of (x, u, e, e', ...)."""

from __future__ import annotations

import numpy as np
from flint import fmpq

from pricing_core.linalg.rational import RationalMatrix, exact_solution, sparse_product
from pricing_core.models.circuits.hidden_constraints import CompletedEquations


def solved_states(full: CompletedEquations, W: RationalMatrix, k: int) -> RationalMatrix:
    """Return s for (x, u, e, ...) from W s = x and P_s s + R_s e = 0, shape (states, n + k + e).

    Examples
    --------
    Capacitors of 1 and 3 in series across a source: of 4 V, the first has 3 V more than x.

    >>> from pricing_core.models.circuits.elements import Capacitor
    >>> from pricing_core.models.circuits.hidden_constraints import completed, continuous_coordinates
    >>> from pricing_core.models.circuits.sources import VoltageSource
    >>> from pricing_core.models.circuits.tableau import tableau
    >>> pair = Capacitor("C1", "a", "b", 1), Capacitor("C2", "b", "0", 3)
    >>> divider = tableau([VoltageSource("V1", "a", "0", 4), *pair])
    >>> full = completed(divider)
    >>> solved_states(full, continuous_coordinates(divider, full.P_s, []), 0)[0].tolist()
    [1, 3/4, 0]
    """
    n, hidden, inputs = len(W), len(full.P_s), full.R.shape[1]
    right = zeros(hidden + n, n + k + inputs)
    right[:hidden, n + k :] = -full.R_s
    right[range(hidden, hidden + n), range(n)] = fmpq(1)
    solution = exact_solution(np.vstack([full.P_s, W]), right)
    assert solution is not None  # W and the constraint are complementary
    return solution


def solved_unknowns(full: CompletedEquations, states: RationalMatrix, u: list[int]) -> RationalMatrix:
    """Return a for (x, u, e, ...), shape (a, n + k + e); u are the columns of K that are the multipliers."""
    unknowns, inputs = full.K.shape[1], full.R.shape[1]
    k = len(u)
    n = states.shape[1] - k - inputs
    right = -sparse_product(full.P, states)
    right[:, n : n + k] -= full.K[:, u]
    right[:, n + k :] -= full.R
    others = [j for j in range(unknowns) if j not in u]
    solution = exact_solution(full.K[:, others], right)
    assert (
        solution is not None
    )  # the multipliers are independent, and the states satisfy the hidden constraints
    a = zeros(unknowns, n + k + inputs)
    a[others] = solution
    a[u, range(n, n + k)] = fmpq(1)
    return a


def zeros(rows: int, columns: int) -> RationalMatrix:
    """Return a matrix of zeros."""
    return np.full((rows, columns), fmpq(0), dtype=object)
