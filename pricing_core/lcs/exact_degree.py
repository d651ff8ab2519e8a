"""The relative degree of a small system in exact arithmetic, whatever the scales of its data."""

from collections.abc import Iterable
from fractions import Fraction
from typing import NamedTuple

from pricing_core.arrays import Matrix
from pricing_core.lcs.system import LCS
from pricing_core.linalg.exact import IntegerMatrix, solve_exactly

LARGEST_EXACT = 6  # pairs up to which exact arithmetic is affordable
LARGEST_STATE = 12
LARGEST_WORK = 60_000  # k times the binary digits of the longest numbers: about half a second
GAP = 64  # the two values of s have the ratio 2**64


class _Integers(NamedTuple):
    """cA, cB, cC, cD as integers, c a common denominator of all entries."""

    A: IntegerMatrix  # (n, n)
    B: IntegerMatrix  # (n, k)
    C: IntegerMatrix  # (k, n)
    D: IntegerMatrix  # (k, k)


def exact_degree(system: LCS, modes: Iterable[tuple[int, ...]]) -> int | None:
    """Return the largest power of s in G_II(s)^-1 over the given modes I, at least 0, or None: too costly.

    The floating-point numbers of the system are taken for the rationals that they are. G_II^-1 is computed for
    two values of s so large that the leading power outweighs all others together, and the power is read off
    its growth. Modes whose G_II is singular for every s are passed over.

    Cost: a millisecond for n = 2 and k = 4, about half a second at worst; None where n > 12, or n k times the
    length of s is more than 60000 binary digits.

    Examples
    --------
    G(s) = 1e-9 + 1/s tends to the feedthrough, 1/s alone to zero:

    >>> exact_degree(LCS([[0]], [[1]], [[1]], [[1e-9]]), [(0,)])
    0
    >>> exact_degree(LCS([[0]], [[1]], [[1]]), [(0,)])
    1
    """
    if system.shape[0] > LARGEST_STATE:
        return None
    integers = _integers(system)
    digits = _digits_of_s(integers)
    if len(integers.A) * len(integers.D) * digits > LARGEST_WORK:
        return None
    wanted = tuple(modes)
    near, far = (_sizes(integers, 1 << digits + gap, wanted) for gap in (0, GAP))
    growths = (b - a for a, b in zip(near, far, strict=True) if a is not None and b is not None)
    return max((round(growth / GAP) for growth in growths if growth > 0), default=0)


def _integers(system: LCS) -> _Integers:
    matrices = (system.A, system.B, system.C, system.D)
    # Every denominator is a power of two, so the largest is a multiple of all.
    common = max((Fraction(a).denominator for M in matrices for a in M.ravel().tolist()), default=1)
    return _Integers(*(_multiple(M, common) for M in matrices))


def _multiple(M: Matrix, common: int) -> IntegerMatrix:
    return [[int(common * Fraction(a)) for a in row] for row in M.tolist()]


def _digits_of_s(integers: _Integers) -> int:
    """Return b such that c s = 2**b lies beyond all that could hide the leading power of a minor.

    The minors of [[c s - cA, cB], [cC, cD]] are polynomials in c s with integer coefficients, of size at most
    the product of the row sums, and a leading coefficient is at least 1.
    """
    left, right = [*integers.A, *integers.C], [*integers.B, *integers.D]
    sums = (1 + sum(map(abs, [*a, *b])) for a, b in zip(left, right, strict=True))
    return GAP + sum(row_sum.bit_length() for row_sum in sums)


def _sizes(integers: _Integers, cs: int, modes: tuple[tuple[int, ...], ...]) -> list[int | None]:
    """Return log2 of the largest entry of G_II(s)^-1, to within 1 and up to a constant, or None: singular."""
    A, B, C, D = integers
    resolvent = [[cs * (i == j) - a for j, a in enumerate(row)] for i, row in enumerate(A)]
    solved = solve_exactly(resolvent, B)
    assert solved is not None  # c s is larger than every eigenvalue of cA
    X, pivot = solved  # X = pivot (c s - cA)^-1 cB
    G = [
        [sum(c * x[j] for c, x in zip(C[i], X, strict=True)) + pivot * d for j, d in enumerate(D[i])]
        for i in range(len(D))
    ]
    return [_size_of_inverse(G, pivot, mode) for mode in modes]


def _size_of_inverse(G: IntegerMatrix, pivot: int, mode: tuple[int, ...]) -> int | None:
    part = [[G[i][j] for j in mode] for i in mode]
    identity = [[pivot * (i == j) for j in mode] for i in mode]
    solved = solve_exactly(part, identity, previous=pivot)
    if solved is None:
        return None
    inverse, determinant = solved
    return max(abs(a) for row in inverse for a in row).bit_length() - abs(determinant).bit_length()
