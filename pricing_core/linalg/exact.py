"""Exact linear algebra on integer matrices: elimination without fractions."""

from typing import TypeAlias

IntegerMatrix: TypeAlias = list[list[int]]


def solve_exactly(
    M: IntegerMatrix, R: IntegerMatrix, *, previous: int = 1
) -> tuple[IntegerMatrix, int] | None:
    """Return X, d with M X = d R and d = +-det M, all integers, or None where M is singular.

    Fraction-free Gauss-Jordan elimination (Bareiss 1968): every division is exact, and every number on the
    way is a minor of (M, R), so that none is longer than it must be.

    Parameters
    ----------
    M : list of n rows of n int
    R : list of n rows of m int
    previous : int
        Last pivot of an elimination that led to M and R, which this call goes on with. Then M and R are
        multiples `previous` M0 and `previous` R0 of rational matrices, d = +-det M0 times `previous`, and
        M0 X = d R0.

    Notes
    -----
    Cost: n**2 (n + m) products of integers that grow to n times the length of the entries.

    Examples
    --------
    >>> solve_exactly([[2, 1], [1, 3]], [[1, 0], [0, 1]])
    ([[3, -1], [-1, 2]], 5)
    >>> solve_exactly([[1, 2], [2, 4]], [[1], [0]]) is None
    True
    """
    n = len(M)
    table = [[*left, *right] for left, right in zip(M, R, strict=True)]
    pivot = previous
    for j in range(n):
        chosen = next((i for i in range(j, n) if table[i][j]), None)
        if chosen is None:
            return None
        table[j], table[chosen] = table[chosen], table[j]
        last, pivot, pivot_row = pivot, table[j][j], table[j]
        for i in range(n):
            if i != j:
                factor = table[i][j]
                table[i] = [
                    (pivot * a - factor * b) // last for a, b in zip(table[i], pivot_row, strict=True)
                ]
    return [row[n:] for row in table], pivot
