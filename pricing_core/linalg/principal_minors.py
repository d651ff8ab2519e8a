"""All principal minors of a polynomial matrix, and the solutions of its principal subsystems."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from flint import fmpz_poly

from pricing_core.linalg.polynomials import sign_at_infinity

PolynomialMatrix = list[list[fmpz_poly]]


class PrincipalSolution(NamedTuple):
    """For a set S: minor = p det G_SS, and numerators over it of u_S (i in S) and y (i outside S).

    u_S = -G_SS^-1 q_S and y = q + G u for G = N / p and the given q / p, the numerators without the sign of u.
    """

    members: int  # bit i set: i in S
    minor: fmpz_poly
    column: list[fmpz_poly]  # (k,)


def principal_solutions(p: fmpz_poly, N: PolynomialMatrix, q: list[fmpz_poly]) -> Iterator[PrincipalSolution]:
    """Yield the solution for every S that elimination reaches by principal pivots in increasing order.

    All others contain an S' with singular G_S'S'. Fraction-free Gauss-Jordan elimination (Bareiss 1968),
    shared between the sets: p must be such that p times any minor of N / p is a polynomial, as with the
    characteristic polynomial of a transfer matrix, and the degrees stay below its own.

    Cost: 2**k times about 3 k products of polynomials, 0.15 s for k = 10 and coefficients of 100 bits.
    """
    rows = [[*left, right] for left, right in zip(N, q, strict=True)]
    yield from _branches(0, 0, p, rows)


def _branches(
    start: int, members: int, minor: fmpz_poly, rows: PolynomialMatrix
) -> Iterator[PrincipalSolution]:
    """`rows` holds the columns from `start` on, and the right-hand side."""
    k = len(rows)
    if start == k:
        yield PrincipalSolution(members, minor, [row[-1] for row in rows])
        return
    yield from _branches(start + 1, members, minor, [row[1:] for row in rows])
    pivot_row = rows[start]
    pivot = pivot_row[0]
    if not pivot:
        return
    tail = pivot_row[1:]
    eliminated = [
        tail
        if i == start
        else [(pivot * a - row[0] * b) // minor for a, b in zip(row[1:], tail, strict=True)]
        for i, row in enumerate(rows)
    ]
    yield from _branches(start + 1, members | 1 << start, pivot, eliminated)


def principal_minors(p: fmpz_poly, N: PolynomialMatrix) -> list[fmpz_poly]:
    """Return p det (N / p)_SS for all S; bit i of the position tells whether i is in S.

    Conditions and cost as for `principal_solutions`; sets that it does not reach are eliminated one by one.

    Examples
    --------
    >>> one, two, zero = fmpz_poly([1]), fmpz_poly([2]), fmpz_poly()
    >>> principal_minors(one, [[zero, one], [two, zero]])
    [1, 0, 0, (-2)]
    """
    k = len(N)
    minors: list[fmpz_poly | None] = [None] * (1 << k)
    for solution in principal_solutions(p, N, [fmpz_poly()] * k):
        minors[solution.members] = solution.minor
    return [_minor(p, N, members) if minor is None else minor for members, minor in enumerate(minors)]


def _minor(p: fmpz_poly, N: PolynomialMatrix, members: int) -> fmpz_poly:
    chosen = [i for i in range(len(N)) if members >> i & 1]
    rows = [[N[i][j] for j in chosen] for i in chosen]
    last, sign = p, 1
    while rows:
        r = next((i for i, row in enumerate(rows) if row[0]), None)
        if r is None:
            return fmpz_poly()
        sign = -sign if r % 2 else sign
        first, *tail = rows.pop(r)
        rows = [
            [(first * a - row[0] * b) // last for a, b in zip(row[1:], tail, strict=True)] for row in rows
        ]
        last = first
    return sign * last


def members_of(position: int, k: int) -> tuple[int, ...]:
    """Return the indices whose bits are set.

    Examples
    --------
    >>> members_of(5, 3)
    (0, 2)
    """
    return tuple(i for i in range(k) if position >> i & 1)


def all_positive(minors: list[fmpz_poly]) -> bool:
    """Tell whether all are positive for large s, the empty one apart: the matrix is then a P-matrix there."""
    return all(sign_at_infinity(minor) > 0 for minor in minors[1:])
