"""A proof that {z >= 0, M z + q >= 0} is empty, checked in exact arithmetic."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import lcm

import numpy as np

from pricing_core.arrays import Matrix, Vector, check_type
from pricing_core.errors import NumericalError
from pricing_core.lcp.linear_programme import minimise
from pricing_core.lcp.problem import LCP
from pricing_core.lcp.scaling import equilibrate

# Smallest margin of a scaled linear programme that is more than rounding.
SMALLEST_MARGIN = 1e-9
LARGEST_DENOMINATORS = (1, 12, 1000)
EPSILON, TINY = float(np.finfo(np.float64).eps), float(np.finfo(np.float64).tiny)


def infeasibility_certificate(problem: LCP) -> Vector | None:
    """Return y >= 0 with M^T y <= 0 and q^T y < 0, or None where none was found.

    For z >= 0 such a y gives y^T (M z + q) < 0, so no z >= 0 has M z + q >= 0 (Gale's form of the lemma of
    Farkas; Cottle, Pang, Stone 1992, theorem 2.7.8). Linear programming proposes y, rational arithmetic on
    the given floating-point numbers accepts or refuses it; None proves nothing.

    Cost: two linear programmes with n unknowns and up to O(n**2) rational operations, few as a rule.

    Parameters
    ----------
    problem : LCP
        Its matrix may be of any class.

    Examples
    --------
    >>> infeasibility_certificate(LCP([[-1.0]], [-1.0]))
    array([1.])
    >>> infeasibility_certificate(LCP([[1.0]], [-1.0])) is None
    True
    """
    check_type("problem", problem, LCP)
    if problem.size == 0:
        return None
    scaled = equilibrate(problem)
    for y in (_strict_candidate(scaled.M, scaled.q), _extreme_candidate(scaled.M, scaled.q)):
        if y is None or not y.any():
            continue
        certificate = scaled.row * y
        for candidate in (certificate, *_rounded(certificate)):
            if _proves(problem.dense(), problem.q, candidate):
                return candidate
    return None


def _strict_candidate(M: Matrix, q: Vector) -> Vector | None:
    """Maximise t, a margin that survives rounding: M^T y + t <= 0, q^T y + t <= 0, 0 <= y, t <= 1."""
    rows = np.hstack([np.vstack([M.T, q]), np.ones((q.size + 1, 1))])
    y_and_t = _minimise(np.append(np.zeros(q.size), -1.0), rows)
    return None if y_and_t is None else y_and_t[:-1]


def _extreme_candidate(M: Matrix, q: Vector) -> Vector | None:
    """Minimise q^T y subject to M^T y <= 0, 0 <= y <= 1: a vertex, for certificates without a margin."""
    return _minimise(q, M.T)


def _minimise(cost: Vector, rows: Matrix) -> Vector | None:
    """Minimise the cost of x in [0, 1]^m subject to rows x <= 0; None unless the least cost is negative."""
    try:
        x = minimise(cost, rows, np.zeros(len(rows)), np.ones(cost.size))
    except NumericalError:
        return None  # no proposal, nothing proved
    return None if x is None or cost @ x > -SMALLEST_MARGIN else x


def _rounded(y: Vector) -> Iterator[Vector]:
    """Yield integer multiples of y with small ratios: often the exact vertex behind the rounded one."""
    for largest in LARGEST_DENOMINATORS:
        ratios = [Fraction(v).limit_denominator(largest) for v in (y / np.max(y)).tolist()]
        common = lcm(*(ratio.denominator for ratio in ratios))
        yield np.array([float(ratio * common) for ratio in ratios])


def _proves(M: Matrix, q: Vector, y: Vector) -> bool:
    """Tell whether M^T y <= 0 and q^T y < 0 hold exactly for y >= 0."""
    table = np.column_stack([M, q])
    products = y @ table
    # |rounding error of products| <= n eps sum |terms| (1 + ...), Higham 2002, (3.5); twice that is safe.
    doubt = 2.0 * len(y) * EPSILON * (np.abs(y) @ np.abs(table)) + TINY
    if (products > doubt).any():
        return False
    doubtful = np.flatnonzero(products >= -doubt)
    exact = {j: _exact_product(y, table[:, j]) for j in doubtful.tolist()}
    return exact.get(len(y), Fraction(-1)) < 0 and all(value <= 0 for value in exact.values())


def _exact_product(y: Vector, column: Vector) -> Fraction:
    terms = ((Fraction(a) * Fraction(b)) for a, b in zip(y.tolist(), column.tolist(), strict=True) if a and b)
    return sum(terms, Fraction())
