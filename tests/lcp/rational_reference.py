"""What small complementarity problems have, by rational arithmetic over all their cells: a second way to the answer."""

from fractions import Fraction
from itertools import combinations, product

import numpy as np
from flint import fmpq, fmpq_mat

from pricing_core.arrays import Matrix, Vector


def has_solution(M: Matrix, N: Matrix, q: Vector) -> bool:
    """Tell whether M w = N z + q has 0 <= w _|_ z >= 0: then some vertex of one of the 2**n cells is a solution."""
    table = [[Fraction(v) for v in row] for row in np.column_stack([M, -N, q]).tolist()]
    n = len(table)
    for cell in product((0, 1), repeat=n):
        columns = [i + n * side for i, side in enumerate(cell)]
        for size in range(n + 1):
            if any(_is_nonnegative(table, support) for support in combinations(columns, size)):
                return True
    return False


def lcp_has_solution(M: Matrix, q: Vector) -> bool:
    """Tell whether w = M z + q has 0 <= w _|_ z >= 0."""
    return has_solution(np.eye(len(q)), M, q)


def _is_nonnegative(table: list[list[Fraction]], support: tuple[int, ...]) -> bool:
    """Tell whether the equations have exactly one solution with these columns, and that is nonnegative."""
    rows = [[row[j] for j in (*support, -1)] for row in table]
    for k in range(len(support)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k]), None)
        if pivot is None:
            return False
        rows[k], rows[pivot] = rows[pivot], rows[k]
        first = [v / rows[k][k] for v in rows[k]]
        rows = [
            first if i == k else [a - row[k] * b for a, b in zip(row, first, strict=True)]
            for i, row in enumerate(rows)
        ]
    return all(row[-1] >= 0 for row in rows[: len(support)]) and not any(
        row[-1] for row in rows[len(support) :]
    )


def exact(values: Matrix) -> list[list[fmpq]]:
    """Return the rationals that floating-point numbers are."""
    return [[fmpq(*value.as_integer_ratio()) for value in row] for row in np.atleast_2d(values).tolist()]


def least_solution(M: Matrix, q: Vector, known: Vector) -> Vector:
    """Return the least of {z >= 0, M z + q >= 0, (M + M')(z - known) = 0, q'(z - known) = 0}, over all active sets."""
    n = len(q)
    rows, (z,), (offset,) = exact(M), exact(known), exact(q)
    equal = [[rows[i][j] + rows[j][i] for j in range(n)] for i in range(n)] + [offset]
    values = [sum((a * b for a, b in zip(row, z, strict=True)), fmpq(0)) for row in equal]
    least = [[fmpq(int(i == j)) for j in range(n)] for i in range(n)] + rows
    bounds = [fmpq(0)] * n + [-v for v in offset]
    best: list[fmpq] | None = None
    for size in range(n + 1):
        for active in combinations(range(2 * n), size):
            found = _foot(equal + [least[i] for i in active], values + [bounds[i] for i in active], n)
            if found is None or (best is not None and _square(found) >= _square(best)):
                continue
            if all(
                sum(a * b for a, b in zip(row, found, strict=True)) >= b
                for row, b in zip(least, bounds, strict=True)
            ):
                best = found
    assert best is not None
    return np.array([int(v.p) / int(v.q) for v in best])


def _foot(rows: list[list[fmpq]], values: list[fmpq], n: int) -> list[fmpq] | None:
    """Return the least z with rows z = values, None where there is none."""
    flat = [v for row, value in zip(rows, values, strict=True) for v in (*row, value)]
    reduced = [row for row in fmpq_mat(len(rows), n + 1, flat).rref()[0].tolist() if any(row)]
    if any(not any(row[:-1]) for row in reduced):
        return None
    if not reduced:
        return [fmpq(0)] * n
    R = fmpq_mat([row[:-1] for row in reduced])
    right = fmpq_mat([[row[-1]] for row in reduced])
    return list((R.transpose() * (R * R.transpose()).solve(right)).entries())


def _square(z: list[fmpq]) -> fmpq:
    return sum((v * v for v in z), fmpq(0))
