"""What passivity with Q > 0 says of solutions: their existence, and where the multiplier is not unique.

For s > 0, (11.6) gives v^* G(s) v >= s x^* Q x with x = (sI - A)^-1 B v. So two solutions u, u' of the rational
complementarity problem have the same state, and B w = 0, (D + D^T) w = 0 for w = u' - u.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from flint import fmpq, fmpz_poly

from pricing_core.arrays import IndexSet
from pricing_core.lcs.modes import all_modes
from pricing_core.lcs.rational_system import RationalSystem
from pricing_core.linalg.polynomial_tableau import Tableau, feasible, with_zero_basics
from pricing_core.linalg.polynomials import common_denominator
from pricing_core.linalg.rational import RationalMatrix, exact_kernel, rational_array

LARGEST_PAIRS = 6  # up to which all modes are searched for ambiguous multipliers


def has_solutions_everywhere(system: RationalSystem, g: RationalMatrix) -> bool:
    """Tell whether every x0 has a solution: some x and u >= 0 with Cx + Du + g >= 0; else none has.

    The problem at a large s is a monotone LCP, solvable where feasible. By the lemma of Farkas it is infeasible
    iff v >= 0, G^T v <= 0, q^T v < 0 for some v; then v^T G v = 0, whence C^T v = 0 and B v = 0 by (11.6)
    for G and for G^T, so that D^T v <= 0 and g^T v < 0 remain: no x0 enters.
    """
    if not g.any():
        return True
    n, k = system.shape
    rows = np.hstack([-system.C, system.C, -system.D, g[:, None]])
    start = Tableau(
        fmpz_poly([1]),
        [_integer_row(row) for row in rows],
        tuple(range(2 * n + k, 2 * n + 2 * k)),
        tuple(range(2 * n + k)),
    )
    return feasible(start) is not None


def ambiguous_states(system: RationalSystem, g: RationalMatrix) -> Iterator[RationalMatrix]:
    """Yield an x for every mode and pair i in which 0 <= Cx + Du + g _|_ u >= 0 leaves u_i open, B u being fixed.

    Where there is none, no x0 has two multipliers. The solutions with the same x and B u form a convex set, as
    D is positive semidefinite, and lie in one mode; both y and y' then vanish on I, and u and u' outside.
    Offsets are made homogeneous: a factor h >= 0 of g, and x / h where h > 0.
    """
    for mode in all_modes(system.shape[1]):
        chosen = list(mode)
        B, D = system.B[:, chosen], system.D[np.ix_(chosen, chosen)]
        kernel = exact_kernel(np.vstack([B, D]))
        for position in np.flatnonzero(kernel.any(axis=1)).tolist():
            x = _ambiguous_state(system, g, mode, position)
            if x is not None:
                yield x


def _ambiguous_state(
    system: RationalSystem, g: RationalMatrix, mode: IndexSet, position: int
) -> RationalMatrix | None:
    """Solve for (x+, x-, u, u', y, y', h) >= 0 with u'_i - u_i = 1."""
    n, k = system.shape
    chosen, outside = list(mode), [i for i in range(k) if i not in mode]
    m, free = len(chosen), len(outside)
    D, B = system.D[:, chosen], system.B[:, chosen]
    slack = rational_array(np.eye(k, dtype=int)[:, outside])
    zero_D, zero_slack = 0 * D, 0 * slack
    difference = rational_array(np.eye(m, dtype=int)[[position]])
    column = g[:, None] if g.any() else g[:, None][:, :0]
    states = np.hstack([system.C, -system.C])
    equations = np.vstack(
        [
            np.hstack([states, D, zero_D, -slack, zero_slack, column]),
            np.hstack([states, zero_D, D, zero_slack, -slack, column]),
            _padded(np.hstack([-B, B]), 2 * n, 2 * free + column.shape[1]),
            _padded(np.hstack([-difference, difference]), 2 * n, 2 * free + column.shape[1]),
        ]
    )
    right = rational_array(np.zeros(len(equations), dtype=int))
    right[-1] = fmpq(1)
    count = equations.shape[1]
    rows = [_integer_row(row) for row in np.hstack([equations, right[:, None]])]
    zeros = range(count, count + len(rows))
    start = Tableau(fmpz_poly([1]), rows, tuple(zeros), tuple(range(count)))
    reduced = with_zero_basics(start, frozenset(zeros))
    point = None if reduced is None else feasible(reduced)
    if point is None:
        return None
    values = np.full(count, fmpq(0), dtype=object)
    for variable, row in zip(point.basic, point.rows, strict=True):
        values[variable] = fmpq(row[-1][0], point.d[0])
    h = values[-1] if column.shape[1] else fmpq(1)
    x: RationalMatrix = values[:n] - values[n : 2 * n]
    return x / h if h else x


def _padded(M: RationalMatrix, left: int, right: int) -> RationalMatrix:
    zero = rational_array(np.zeros((len(M), left + right), dtype=int))
    return np.hstack([zero[:, :left], M, zero[:, left:]])


def _integer_row(row: RationalMatrix) -> list[fmpz_poly]:
    scale = common_denominator(row)
    return [fmpz_poly([fmpq(scale * entry).p]) for entry in row]
