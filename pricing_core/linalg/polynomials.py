"""Polynomials and rational functions in s, ordered by their sign for all sufficiently large s."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_poly, fmpz, fmpz_poly
from scipy.linalg import expm

from pricing_core.arrays import Matrix, Vector
from pricing_core.linalg.rational import rational


def sign_at_infinity(p: fmpz_poly | fmpz) -> int:
    """Return the sign of p(s) for all sufficiently large s: that of the leading coefficient, 0 for p = 0.

    A number is the constant polynomial.

    Examples
    --------
    >>> sign_at_infinity(fmpz_poly([1000000, -1])), sign_at_infinity(fmpz_poly([]))
    (-1, 0)
    """
    leading = p if isinstance(p, fmpz) else p.leading_coefficient()
    return (leading > 0) - (leading < 0)


def evaluate(p: fmpq_poly, s: complex) -> tuple[fmpq, fmpq]:
    """Return the real and imaginary parts of p(s), exact for the rational s that `rational` makes of a float.

    Examples
    --------
    >>> evaluate(fmpq_poly([1, 0, 1]), 1 + 2j)
    (-2, 4)
    """
    a, b = rational(s.real), rational(s.imag)
    if not b:
        return fmpq(p(a)), fmpq(0)
    remainder = p % fmpq_poly([a * a + b * b, -2 * a, 1])  # s is a root of the divisor
    slope, constant = remainder[1], remainder[0]
    return slope * a + constant, slope * b


def common_denominator(values: Iterable[fmpq]) -> int:
    """Return the least common multiple of the denominators."""
    return math.lcm(*(int(value.q) for value in values))


class RationalVector(NamedTuple):
    """The rational functions numerators[i] / denominator, Laplace transforms of impulsive-smooth distributions."""

    numerators: tuple[fmpq_poly, ...]
    denominator: fmpq_poly

    def reduced(self) -> RationalVector:
        """Return the same functions in lowest terms, the denominator with leading coefficient 1."""
        common = self.denominator
        for numerator in self.numerators:
            common = common.gcd(numerator)
        divisor = common * (self.denominator.leading_coefficient() / common.leading_coefficient())
        return RationalVector(tuple(p // divisor for p in self.numerators), self.denominator // divisor)

    def polynomial_part(self) -> Matrix:
        """Return the coefficients of 1, s, s**2, ... as rows, shape (order, length), order 0 where proper.

        They are those of delta, delta', ... in the distribution (11.79).

        Examples
        --------
        >>> RationalVector((fmpq_poly([1, 0, 1]),), fmpq_poly([0, 1])).polynomial_part()
        array([[0.],
               [1.]])
        """
        quotients = [numerator // self.denominator for numerator in self.numerators]
        order = max((quotient.degree() + 1 for quotient in quotients), default=0)
        rows = [[float(quotient[j]) for quotient in quotients] for j in range(order)]
        return np.array(rows).reshape(order, len(quotients))

    def initial_value(self) -> Vector:
        """Return f(0+), the limit of s times the strictly proper part.

        Examples
        --------
        >>> RationalVector((fmpq_poly([0, 5, 1]),), fmpq_poly([1, 1])).initial_value()
        array([-4.])
        """
        return np.array([float(value) for value in self.exact_initial_value()])

    def exact_initial_value(self) -> list[fmpq]:
        """Return f(0+) as rational numbers."""
        m = self.denominator.degree()
        leading = self.denominator.leading_coefficient()
        remainders = (numerator % self.denominator for numerator in self.numerators)
        return [remainder[m - 1] / leading if m else fmpq(0) for remainder in remainders]

    def is_strictly_proper(self) -> bool:
        """Tell whether there are no impulses."""
        return all(p.degree() < self.denominator.degree() for p in self.numerators)

    def same_smooth_part(self, other: RationalVector) -> bool:
        """Tell whether the two differ by polynomials alone.

        Examples
        --------
        1 + 1/s and 1/s:

        >>> s = fmpq_poly([0, 1])
        >>> RationalVector((s + 1,), s).same_smooth_part(RationalVector((fmpq_poly([1]),), s))
        True
        """
        return all(
            (a % self.denominator) * other.denominator == (b % other.denominator) * self.denominator
            for a, b in zip(self.numerators, other.numerators, strict=True)
        )

    def smooth_part(self, t: float) -> Vector:
        """Return f(t) for t >= 0, the inverse Laplace transform of the strictly proper part.

        It is the output of the system in companion form: one matrix exponential of the denominator's order.

        Examples
        --------
        1 / (s + 1) is the transform of exp(-t):

        >>> RationalVector((fmpq_poly([1]),), fmpq_poly([1, 1])).smooth_part(2.0) * np.exp(2.0)
        array([1.])
        """
        m = self.denominator.degree()
        if m < 1:
            return np.zeros(len(self.numerators))
        leading = self.denominator.leading_coefficient()
        companion = np.eye(m, k=1)
        companion[-1] = [-float(self.denominator[j] / leading) for j in range(m)]
        remainders = (numerator % self.denominator for numerator in self.numerators)
        rows = [[float(p[j] / leading) for j in range(m)] for p in remainders]
        return np.asarray(np.array(rows).reshape(-1, m) @ expm(companion * t)[:, -1])


def is_initially_nonnegative(transform: RationalVector) -> bool:
    """Tell whether every component is nonnegative for all sufficiently large s (Definition 11.1).

    That is: its leading impulse is positive, or it has none and the smooth part is nonnegative just after 0.

    Examples
    --------
    delta' - 5 delta is initially nonnegative, -t is not:

    >>> is_initially_nonnegative(RationalVector((fmpq_poly([-5, 1]),), fmpq_poly([1])))
    True
    >>> is_initially_nonnegative(RationalVector((fmpq_poly([-1]),), fmpq_poly([0, 0, 1])))
    False
    """
    positive = transform.denominator.leading_coefficient() > 0
    return all(not p or (p.leading_coefficient() > 0) == positive for p in transform.numerators)
