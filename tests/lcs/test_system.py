from fractions import Fraction

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, PiecewiseConstant


def test_missing_parts_are_zero():
    system = LCS([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    assert system.shape == (2, 1)
    assert not system.D.any()
    assert system.f.after(3.0).tolist() == [0.0, 0.0]
    assert system.g.before(3.0).tolist() == [0.0]


def test_arguments_are_copied_and_kept_read_only():
    A = np.zeros((1, 1))
    system = LCS(A, [[1.0]], [[1.0]])
    A[0, 0] = 7.0
    assert system.A[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 1.0


def test_piecewise_constant_values_on_both_sides_of_a_knot():
    step = PiecewiseConstant([1.0, 2.0], [3.0, 4.0])
    assert step.before(1.0).tolist() == [3.0]
    assert step.after(1.0).tolist() == [4.0]
    assert step.after(99.0).tolist() == [4.0]
    assert step.jumps.tolist() == [1.0]


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("A", lambda: LCS([[1.0, 2.0]], [[1.0]], [[1.0]])),
        ("B", lambda: LCS([[1.0]], [[1.0], [2.0]], [[1.0]])),
        ("C", lambda: LCS([[1.0]], [[1.0]], [[1.0, 2.0]])),
        ("D", lambda: LCS([[1.0]], [[1.0]], [[1.0]], [[1.0, 2.0]])),
        ("f", lambda: LCS([[1.0]], [[1.0]], [[1.0]], f=[1.0, 2.0])),
        ("g", lambda: LCS([[1.0]], [[1.0]], [[1.0]], g=PiecewiseConstant([0.0], [[1.0, 2.0]]))),
        ("A", lambda: LCS([[np.inf]], [[1.0]], [[1.0]])),
        ("A", lambda: LCS([["x"]], [[1.0]], [[1.0]])),
        ("times", lambda: PiecewiseConstant([1.0, 1.0], [1.0, 2.0])),
        ("times", lambda: PiecewiseConstant([], [])),
        ("values", lambda: PiecewiseConstant([1.0], [1.0, 2.0])),
    ],
)
def test_shapes_that_do_not_fit_are_named(field, make):
    with pytest.raises(InvalidInputError, match=f"^{field} = "):
        make()


def test_fractions_are_rounded_for_simulation_and_kept_for_exact_methods():
    third = Fraction(1, 3)
    system = LCS([[third]], [[1]], [[10**30]], g=[third])
    assert system.A[0, 0] == 1 / 3
    assert system.given[0][0, 0] == third
    assert system.given[2][0, 0] == 10**30
    assert system.g.given_after(0.0)[0] == third


def test_fractions_beyond_floating_point_are_refused():
    with pytest.raises(InvalidInputError, match="A"):
        LCS([[Fraction(10**400)]], [[1]], [[1]])
