"""Exact linear algebra over the rationals: conversion, kernel, image, solution.

Matrices are NumPy arrays of `fmpq`, so that products and blocks are written as for floating-point numbers; the
eliminations are FLINT's.
"""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
from flint import fmpq, fmpq_mat
from numpy.typing import NDArray

from pricing_core.arrays import Matrix

RationalMatrix: TypeAlias = NDArray[np.object_]  # entries: fmpq
DECIMAL_DIGITS = 15  # every decimal number of so many digits survives the way to a float and back
LARGEST_INTEGER = 2.0**53


def rational(value: object) -> fmpq:
    """Return the rational number that a finite real number stands for.

    Integers and `Fraction` are taken exactly. A float is taken for the decimal number of its shortest repr
    where that has at most 15 significant digits (0.1 is 1/10, 1e-6 is 1/1000000), otherwise for the dyadic
    rational that it is (0.1 + 0.2 is not 3/10).

    Examples
    --------
    >>> print(rational(0.1), rational(Fraction(2, 6)), rational(3), rational(1 / 3))
    1/10 1/3 3 6004799503160661/18014398509481984
    """
    if isinstance(value, int | np.integer):
        return fmpq(int(value))
    if isinstance(value, Fraction):
        return fmpq(value.numerator, value.denominator)
    number = float(value)  # type: ignore[arg-type]
    if number.is_integer() and abs(number) < LARGEST_INTEGER:
        return fmpq(int(number))
    decimal = Decimal(repr(number))
    short = len(decimal.normalize().as_tuple().digits) <= DECIMAL_DIGITS
    numerator, denominator = (decimal if short else number).as_integer_ratio()
    return fmpq(numerator, denominator)


def rational_array(values: NDArray[Any]) -> RationalMatrix:
    """Return the array of the rationals that the entries stand for, of the same shape; see `rational`.

    Examples
    --------
    >>> rational_array(np.array([0.5, 3.0])).tolist()
    [1/2, 3]
    """
    exact = np.empty(values.shape, dtype=object)
    exact.ravel()[:] = [rational(value) for value in values.ravel().tolist()]
    return exact


def rounded(M: RationalMatrix) -> Matrix:
    """Return the nearest floating-point numbers, of the same shape."""
    return M.astype(np.float64)


def as_fractions(M: RationalMatrix) -> RationalMatrix:
    """Return the same numbers as `Fraction`, which every public function takes."""
    exact = np.empty(M.shape, dtype=object)
    exact.ravel()[:] = [Fraction(int(fmpq(entry).p), int(fmpq(entry).q)) for entry in M.ravel().tolist()]
    return exact


def to_flint(M: RationalMatrix) -> fmpq_mat:
    """Return the FLINT matrix."""
    return fmpq_mat(M.shape[0], M.shape[1], [fmpq(entry) for entry in M.ravel().tolist()])


def from_flint(M: fmpq_mat) -> RationalMatrix:
    """Return the array of a FLINT matrix."""
    exact = np.empty((M.nrows(), M.ncols()), dtype=object)
    exact.ravel()[:] = M.entries()
    return exact


def exact_product(M: RationalMatrix, N: RationalMatrix) -> RationalMatrix:
    """Return M N, for matrices of some size faster than the product of the arrays."""
    if not M.size or not N.size:
        return np.full((M.shape[0], N.shape[1]), fmpq(0), dtype=object)
    return from_flint(to_flint(M) * to_flint(N))


def sparse_product(M: RationalMatrix, N: RationalMatrix) -> RationalMatrix:
    """Return M N from the entries that are not zero, for matrices of which these are few.

    Examples
    --------
    >>> sparse_product(rational_array(np.array([[1, 0], [2, 3]])), rational_array(np.array([[5], [7]]))).tolist()
    [[5], [31]]
    """
    rows = [[(j, entry) for j, entry in enumerate(row) if entry] for row in N.tolist()]
    product = np.full((M.shape[0], N.shape[1]), fmpq(0), dtype=object)
    for i, row in enumerate(M.tolist()):
        total: dict[int, fmpq] = {}
        for factor, terms in zip(row, rows, strict=True):
            if factor:
                for j, entry in terms:
                    total[j] = total[j] + factor * entry if j in total else factor * entry
        for j, value in total.items():
            product[i, j] = value
    return product


def exact_rank(M: RationalMatrix) -> int:
    """Return the rank of an (m, n) matrix.

    Examples
    --------
    >>> exact_rank(rational_array(np.array([[1.0, 0.1], [10.0, 1.0]])))
    1
    """
    return to_flint(M).rank() if M.size else 0


def exact_kernel(M: RationalMatrix) -> RationalMatrix:
    """Return a basis of {x : M x = 0} as columns, shape (n, n - rank), by elimination in O(m n**2).

    Examples
    --------
    >>> exact_kernel(rational_array(np.array([[1, 2]]))).tolist()
    [[-2], [1]]
    """
    n = M.shape[1]
    reduced, pivots = _reduced_rows(M)
    free = [j for j in range(n) if j not in pivots]
    basis = np.full((n, len(free)), fmpq(0), dtype=object)
    for column, j in enumerate(free):
        basis[j, column] = fmpq(1)
        basis[pivots, column] = -reduced[: len(pivots), j]
    return basis


def exact_image(M: RationalMatrix) -> RationalMatrix:
    """Return columns of M that form a basis of its range, shape (m, rank).

    Examples
    --------
    >>> exact_image(rational_array(np.array([[1, 2], [2, 4]]))).tolist()
    [[1], [2]]
    """
    return M[:, pivot_columns(M)]


def pivot_columns(M: RationalMatrix) -> list[int]:
    """Return the columns that do not depend on those before them, in order.

    Examples
    --------
    >>> pivot_columns(rational_array(np.array([[1, 2, 0], [2, 4, 1]])))
    [0, 2]
    """
    return _reduced_rows(M)[1]


def exact_solution(M: RationalMatrix, R: RationalMatrix) -> RationalMatrix | None:
    """Return a solution X of M X = R, shape (n, p), zero in the free variables, or None where there is none.

    Examples
    --------
    >>> M, R = rational_array(np.array([[2], [4]])), rational_array(np.array([[1], [2]]))
    >>> exact_solution(M, R).tolist()
    [[1/2]]
    """
    n, columns = M.shape[1], R.shape[1]
    reduced, pivots = _reduced_rows(np.hstack([M, R]))
    if any(pivot >= n for pivot in pivots):
        return None
    X = np.full((n, columns), fmpq(0), dtype=object)
    X[pivots] = reduced[: len(pivots), n:]
    return X


def _reduced_rows(M: RationalMatrix) -> tuple[RationalMatrix, list[int]]:
    """Return the reduced row echelon form and its pivot columns."""
    if not M.size:
        return M, []
    reduced, rank = to_flint(M).rref()
    rows = from_flint(reduced)
    return rows, [int(np.flatnonzero(row)[0]) for row in rows[:rank]]
