"""Lemke's complementary pivoting over the rational numbers and the ordered field of rational functions."""

from __future__ import annotations

from collections.abc import Sequence

from pricing_core.errors import RayTerminationError
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.polynomial_tableau import Element, Row, Tableau
from pricing_core.linalg.polynomials import sign_at_infinity


def solve_polynomial_lemke(
    p: Element,
    N: Sequence[Row],
    q: Row,
    *,
    time_limit: TimeLimit | None = None,
) -> tuple[Row, Element]:
    """Solve p w = N z + q with 0 <= w _|_ z >= 0, for numbers, or polynomials at all sufficiently large s.

    Parameters
    ----------
    p, N, q
        As for `pricing_core.linalg.principal_minors.principal_solutions`, p positive for large s; or whole numbers,
        p times any minor of N / p one too, as where p = 1.

    Returns
    -------
    numerators, denominator : list (k,), number or polynomial
        Numerators and common denominator of z, the denominator positive for large s.

    Raises
    ------
    RayTerminationError
        The path ended on a ray: nothing is proved.
    IterationLimitError
        The time is over.

    Notes
    -----
    The lexicographic rule excludes cycles. Cost: O(k**2) products of polynomials a pivot.
    Source: Cottle, Pang, Stone 1992, algorithm 4.4.5, section 4.9.

    Examples
    --------
    s w = z - s, so that z = s and w = 0:

    >>> from flint import fmpz_poly
    >>> solve_polynomial_lemke(fmpz_poly([0, 1]), [[fmpz_poly([1])]], [fmpz_poly([0, -1])])
    ([x], 1)
    """
    k = len(q)
    covering = 2 * k
    zero = p - p
    rows = [[*(-a for a in row), -p, right] for row, right in zip(N, q, strict=True)]
    tableau = Tableau(p, rows, tuple(range(k)), tuple(range(k, 2 * k + 1)))
    if all(sign_at_infinity(right) >= 0 for right in q):
        return [zero] * k, p
    r = 0
    for i in range(1, k):  # the lexicographic minimum of (q_i, e_i): the last among equals
        if sign_at_infinity(q[i] - q[r]) <= 0:
            r = i
    entering = covering
    while True:
        if time_limit is not None:
            time_limit.check("Lemke's method in exact arithmetic")
        leaving = tableau.basic[r]
        tableau = tableau.pivot(r, tableau.nonbasic.index(entering))
        if leaving == covering:
            values = dict(zip(tableau.basic, (row[-1] for row in tableau.rows), strict=True))
            return [values.get(k + j, zero) for j in range(k)], tableau.d
        entering = leaving + k if leaving < k else leaving - k
        chosen = _leaving_row(tableau, tableau.nonbasic.index(entering), covering, k)
        if chosen is None:
            raise RayTerminationError("Lemke's method in exact arithmetic ended on a ray: nothing is proved")
        r = chosen


def _leaving_row(tableau: Tableau, c: int, covering: int, k: int) -> int | None:
    """Return the row of the lexicographically smallest ratio, None where no entry of the column is positive."""
    rows = [i for i, row in enumerate(tableau.rows) if sign_at_infinity(row[c]) > 0]
    best: int | None = None
    for i in rows:
        if best is None or _precedes(tableau, i, best, c, covering, k):
            best = i
    return best


def _precedes(tableau: Tableau, i: int, j: int, c: int, covering: int, k: int) -> bool:
    """Tell whether row i has the smaller ratio: right-hand sides first, then columns of the inverse basis."""
    first, second = tableau.rows[i], tableau.rows[j]
    order = sign_at_infinity(first[-1] * second[c] - second[-1] * first[c])
    if order:
        return order < 0
    if covering in (tableau.basic[i], tableau.basic[j]):
        return tableau.basic[i] == covering
    for w in range(k):
        a, b = (_inverse_entry(tableau, row, w) for row in (i, j))
        order = sign_at_infinity(a * second[c] - b * first[c])
        if order:
            return order < 0
    return False


def _inverse_entry(tableau: Tableau, row: int, w: int) -> Element:
    """Return the numerator of the inverse basis, which stands in the columns of the slacks."""
    if w in tableau.nonbasic:
        return tableau.rows[row][tableau.nonbasic.index(w)]
    return tableau.d if tableau.basic[row] == w else tableau.d - tableau.d
