"""Signs of determinants and Schur complements of floating-point matrices, exact for the numbers as they are given."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from flint import fmpq_mat, fmpz, fmpz_mat
from scipy.linalg.lapack import dgetrf

from pricing_core.arrays import IndexSet, Matrix

EPSILON = float(np.finfo(np.float64).eps)


def odd_part(value: float) -> tuple[int, int]:
    """Return (a, b) with value = a 2**b, a odd or zero.

    Examples
    --------
    >>> odd_part(12.0), odd_part(0.375)
    ((3, 2), (3, -3))
    """
    numerator, denominator = value.as_integer_ratio()
    if numerator == 0:
        return 0, 0
    twos = (numerator & -numerator).bit_length() - 1
    return numerator >> twos, twos - (denominator.bit_length() - 1)


def whole_numbers(values: list[float], exponents: list[int]) -> tuple[list[fmpz], int]:
    """Return the whole numbers values[i] 2**(exponents[i] - f), and the greatest f for which they are whole.

    Examples
    --------
    >>> whole_numbers([0.5, 3.0], [0, 1])
    ([1, 12], -1)
    """
    parts = [odd_part(value) for value in values]
    powers = [power + e for (_, power), e in zip(parts, exponents, strict=True)]
    least = min((power for (odd, _), power in zip(parts, powers, strict=True) if odd), default=0)
    return [
        fmpz(odd << power - least if odd else 0) for (odd, _), power in zip(parts, powers, strict=True)
    ], least


def determinant_sign(M: Matrix) -> int:
    """Return the sign of det M, 0 where M is singular: by elimination where its rounding cannot matter, else exactly.

    With columns of largest entry near 1, elimination gives det (M + E) with |E| <= 2 n eps |L| |U| by columns (Higham
    2002, theorem 9.3), and by Hadamard's inequality that is off by at most (1 + e)**n - 1 times the product of the
    lengths of the columns, e the largest ratio of lengths of a column of E and of M.

    Examples
    --------
    >>> determinant_sign(np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]])), determinant_sign(1e-200 * np.eye(2))
    (1, 1)
    """
    n = len(M)
    exponents = np.frexp(np.max(np.abs(M), axis=0, initial=0.0))[1]
    scaled = np.ldexp(M, -exponents)
    lengths = np.linalg.norm(scaled, axis=0)
    if not lengths.all():
        return 0
    if n == 0:
        return 1
    factors, rows, info = dgetrf(scaled)
    if info == 0:
        lower, upper = np.tril(factors, -1) + np.eye(n), np.triu(factors)
        errors = np.linalg.norm(np.abs(lower) @ np.abs(upper), axis=0) / lengths
        doubt = np.expm1(n * np.log1p(2.0 * n * EPSILON * float(np.max(errors))))
        pivots = np.diagonal(factors)
        # The logarithm of the determinant over the product of the lengths, which cannot underflow.
        size = float(np.sum(np.log(np.abs(pivots))) - np.sum(np.log(lengths)))
        if size > np.log(2.0 * doubt + 4.0 * n * EPSILON):
            swaps = int(np.count_nonzero(rows != np.arange(n)))
            return 1 if (np.count_nonzero(pivots < 0.0) + swaps) % 2 == 0 else -1
    rows_of_numbers = [whole_numbers(row, (-exponents).tolist())[0] for row in M.tolist()]
    exact = fmpz_mat(rows_of_numbers).det()
    return int(exact > 0) - int(exact < 0)


def schur_complement(M: Matrix, block: IndexSet, rest: IndexSet) -> Matrix:
    """Return M_rr - M_rb M_bb^-1 M_br, each entry the exact one rounded; M_bb is nonsingular.

    Examples
    --------
    >>> schur_complement(np.array([[2.0, 1.0], [1.0, 1.0]]), (0,), (1,))
    array([[0.5]])
    """
    if not rest:
        return np.zeros((0, 0))
    order = [*block, *rest]
    ordered = M[np.ix_(order, order)]
    flat, shift = whole_numbers(ordered.ravel().tolist(), [0] * ordered.size)
    table = np.array(flat, dtype=object).reshape(ordered.shape)
    m = len(block)

    def part(rows: slice, columns: slice) -> fmpq_mat:
        return fmpq_mat(fmpz_mat(table[rows, columns].tolist()))

    inner, outer = slice(0, m), slice(m, None)
    complement = part(outer, outer) - part(outer, inner) * part(inner, inner).solve(part(inner, outer))
    scale = Fraction(2) ** shift
    return np.array(
        [[float(Fraction(int(e.p), int(e.q)) * scale) for e in row] for row in complement.tolist()],
        dtype=np.float64,
    )
