"""The transfer matrix G(s) = C (sI - A)^-1 B + D over the rational functions."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Complex
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_poly, fmpz_poly
from numpy.typing import NDArray

from pricing_core.arrays import check_type
from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcs.modes import as_mode
from pricing_core.lcs.rational_system import RationalSystem, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.linalg.polynomials import common_denominator, evaluate
from pricing_core.linalg.principal_minors import PolynomialMatrix
from pricing_core.linalg.rational import RationalMatrix, from_flint, to_flint


@dataclass(frozen=True, slots=True, eq=False)
class TransferMatrix:
    """G(s) = numerators / denominator, in lowest terms as a whole, the denominator with leading coefficient 1.

    Calling it evaluates G at a real or complex number, exactly, and rounds once.

    Parameters
    ----------
    numerators : tuple of tuples of fmpq_poly, (k, k)
    denominator : fmpq_poly

    Examples
    --------
    >>> G = transfer_matrix(LCS([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]]))
    >>> print(G.numerators[0][0], "/", G.denominator)
    x / x^2 + 1
    >>> G(2.0)
    array([[0.4]])
    """

    numerators: tuple[tuple[fmpq_poly, ...], ...]
    denominator: fmpq_poly

    def __call__(self, s: complex) -> NDArray[np.float64] | NDArray[np.complex128]:
        """Return G(s), shape (k, k), real for real s.

        Raises
        ------
        InvalidInputError
            s is no finite number.
        NumericalError
            s is a pole.
        """
        _check_number(s)
        c, d = evaluate(self.denominator, s)
        size = c * c + d * d
        if not size:
            raise NumericalError(f"G has a pole at s = {s}: evaluate it elsewhere")
        k = len(self.numerators)
        values = np.empty((k, k), dtype=complex)
        for i, row in enumerate(self.numerators):
            for j, numerator in enumerate(row):
                a, b = evaluate(numerator, s)
                values[i, j] = complex(float((a * c + b * d) / size), float((b * c - a * d) / size))
        return values if isinstance(s, complex) else values.real

    def submatrix(self, mode: Iterable[int]) -> TransferMatrix:
        """Return G_II(s), the rows and columns of G in the index set I = `mode` (11.83)."""
        chosen = as_mode(mode, len(self.numerators))
        return TransferMatrix(
            tuple(tuple(self.numerators[i][j] for j in chosen) for i in chosen), self.denominator
        )


def _check_number(s: object) -> None:
    try:
        finite = isinstance(s, Complex) and not isinstance(s, bool) and cmath.isfinite(complex(s))
    except OverflowError:
        finite = False
    if not finite:
        raise InvalidInputError("s", s, "a finite real or complex number")


class PolynomialTransfer(NamedTuple):
    """Polynomials with integer coefficients: diag(row_scale) G = N / p, and diag(row_scale) C (sI - A)^-1 X = M / p.

    p is det(sI - A) times a positive integer. p times any minor of (N, M) / p is again a polynomial with integer
    coefficients, a minor of [[s E - E A, E B, E X], [-C', D', 0]] with E = diag(e_i) and C', D' scaled by rows to
    integers: its degree is at most that of p.
    """

    p: fmpz_poly
    N: PolynomialMatrix  # (k, k)
    M: PolynomialMatrix  # (k, columns of X)
    row_scale: tuple[int, ...]  # (k,), positive


def transfer_matrix(system: LCS) -> TransferMatrix:
    """Return G(s) exactly, for the rational data that `pricing_core.linalg.rational.rational` makes of floats.

    Parameters
    ----------
    system : LCS

    Notes
    -----
    Cost: a characteristic polynomial and n products of (n, n) by (n, k) matrices over the rationals:
    a millisecond for n = k = 10, seconds for n = 100.

    Examples
    --------
    >>> print(transfer_matrix(LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], [[0.5]])).numerators)
    ((1/2*x^2 + 1,),)
    """
    check_type("system", system, LCS)
    p, N, _, row_scale = polynomial_transfer(rational_system(system))
    denominator = fmpq_poly(p)
    numerators = [
        [fmpq_poly(entry) / scale for entry in row] for row, scale in zip(N, row_scale, strict=True)
    ]
    common = denominator
    for numerator in (entry for row in numerators for entry in row):
        common = common.gcd(numerator)
    divisor = common * (denominator.leading_coefficient() / common.leading_coefficient())
    return TransferMatrix(
        tuple(tuple(entry // divisor for entry in row) for row in numerators), denominator // divisor
    )


def polynomial_transfer(system: RationalSystem, X: RationalMatrix | None = None) -> PolynomialTransfer:
    """Return G and, for integer X of shape (n, m), C (sI - A)^-1 X over one multiple of the characteristic polynomial.

    The numerators are the polynomial parts of det(sI - A) times the series of Markov parameters.
    """
    n, k = system.shape
    columns = system.B if X is None else np.hstack([system.B, X])
    A, C, response = to_flint(system.A), to_flint(system.C), to_flint(columns)
    characteristic = A.charpoly().coeffs() if n else [fmpq(1)]
    series = [np.hstack([system.D, np.full((k, columns.shape[1] - k), fmpq(0), dtype=object)])]
    for _ in range(n):
        series.append(from_flint(C * response))
        response = A * response
    coefficients = [
        sum((characteristic[i] * series[i - m] for i in range(m, n + 1)), 0 * series[0]) for m in range(n + 1)
    ]
    factor = math.prod(common_denominator(row) for row in np.hstack([system.A, system.B]))
    row_scale = tuple(common_denominator(row) for row in np.hstack([system.C, system.D]))
    table = [
        [
            _integer_polynomial([factor * scale * M[i, j] for M in coefficients])
            for j in range(columns.shape[1])
        ]
        for i, scale in enumerate(row_scale)
    ]
    p = _integer_polynomial([factor * c for c in characteristic])
    return PolynomialTransfer(p, [row[:k] for row in table], [row[k:] for row in table], row_scale)


def _integer_polynomial(coefficients: list[fmpq]) -> fmpz_poly:
    return fmpz_poly([fmpq(c).p for c in coefficients])
