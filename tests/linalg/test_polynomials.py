import math

import pytest
from flint import fmpq, fmpq_poly

from pricing_core.linalg.polynomials import (
    RationalVector,
    common_denominator,
    evaluate,
    is_initially_nonnegative,
)

S = fmpq_poly([0, 1])


def test_the_parts_of_an_impulsive_smooth_distribution():
    """s^2/(s + 1) = s - 1 + 1/(s + 1): delta' - delta + exp(-t)."""
    w = RationalVector((S * S,), S + 1)
    assert w.polynomial_part().tolist() == [[-1.0], [1.0]]
    assert w.initial_value().tolist() == [1.0]
    assert w.smooth_part(0.5) == pytest.approx([math.exp(-0.5)])
    assert not w.is_strictly_proper()


def test_an_oscillation_with_a_double_pole():
    """2 s/(s^2 + 1)^2 is the transform of t sin t."""
    w = RationalVector((2 * S,), (S * S + 1) ** 2)
    assert w.smooth_part(1.3) == pytest.approx([1.3 * math.sin(1.3)])


def test_lowest_terms():
    w = RationalVector((2 * S * (S + 1), S * (S + 2)), 4 * S * (S - 1)).reduced()
    assert w.denominator == S - 1
    assert w.numerators == ((S + 1) / 2, (S + 2) / 4)


@pytest.mark.parametrize(
    ("numerator", "denominator", "expected"),
    [(S - 100, S, True), (-S, S, False), (fmpq_poly([]), S, True), (-S, -S * S, True), (1 - S, S * S, False)],
)
def test_initially_nonnegative_means_nonnegative_for_large_s(numerator, denominator, expected):
    assert is_initially_nonnegative(RationalVector((fmpq_poly(numerator),), denominator)) is expected


def test_values_at_complex_numbers_are_exact():
    assert evaluate((S * S + 1) ** 3, 1j) == (0, 0)
    assert evaluate(S**3, 0.1 + 0.2j) == (fmpq(1, 1000) - 3 * fmpq(1, 10) * fmpq(4, 100), fmpq(-2, 1000))


def test_common_denominators():
    assert common_denominator([fmpq(1, 4), fmpq(5, 6)]) == 12
    assert common_denominator([]) == 1
