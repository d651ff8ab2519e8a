"""The critical graph against all simple circuits; cyclicity and transient against the powers themselves."""

from fractions import Fraction
from math import gcd, lcm

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.max_plus import critical_graph, cyclicity, eigenvalue, exact, power, sparse, transient
from pricing_core.max_plus.matrices import rows_of
from tests.problems.max_plus_problems import KNOWN, E, simple_circuits, whole_matrices


@pytest.mark.parametrize("known", [k for k in KNOWN if k.cyclicity], ids=str)
@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_cyclicity_and_transient_of_known_matrices(known, storage):
    A = storage(known.A)
    assert cyclicity(A) == known.cyclicity
    assert transient(A) == known.transient


@given(whole_matrices())
@settings(max_examples=120, deadline=None)
def test_the_critical_graph_is_that_of_the_heaviest_simple_circuits(A):
    circuits = [(Fraction(int(w), len(c)), c) for w, c in simple_circuits(A)]
    best = max((mean for mean, _ in circuits), default=E)
    heaviest = [c for mean, c in circuits if mean == best]
    arcs = {arc for c in heaviest for arc in zip(c, c[1:] + c[:1], strict=True)}
    for stored in (A, exact(A)):
        found = critical_graph(stored)
        assert set(found.arcs) == arcs
        assert found.nodes == tuple(sorted({node for c in heaviest for node in c}))
        expected = [
            gcd(*(len(c) for c in heaviest if set(c) <= set(component))) for component in found.components
        ]
        assert list(found.cyclicities) == expected
        assert found.cyclicity == lcm(*expected)


@given(whole_matrices(most=4))
@settings(max_examples=80, deadline=None)
def test_the_transient_is_the_first_power_from_which_on_the_powers_repeat(A):
    A = exact(np.where(A == E, -8.0, A))
    value, period, found = eigenvalue(A), cyclicity(A), transient(A)

    def repeats(k):
        return (power(A, k + period) == power(A, k) + period * value).all()

    assert repeats(found)
    assert repeats(found + 1)
    assert found == 0 or not repeats(found - 1)
    assert transient(A.astype(float)) == found


def test_components_with_periods_two_and_three_have_the_cyclicity_six():
    A = np.full((5, 5), E)
    A[1, 0] = A[0, 1] = A[3, 2] = A[4, 3] = A[2, 4] = 2.0
    A[0, 2] = A[2, 0] = -5.0
    found = critical_graph(A)
    assert found.components == ((0, 1), (2, 3, 4))
    assert (found.cyclicities, found.cyclicity) == ((2, 3), 6)


def test_a_near_tie_takes_long_and_a_limit_ends_it():
    """Loops of 0 and -0.01 with a bridge of -10 each way: 20 / 0.01 steps to forget the slower one."""
    A = exact([[0, -10], [-10, Fraction(-1, 100)]])
    assert transient(A) == 2000
    with pytest.raises(IterationLimitError, match="1000"):
        transient(A, max_steps=1000)


def test_without_a_circuit_the_powers_end_in_epsilon():
    A = [[E, E, E], [1.0, E, E], [E, 1.0, E]]
    assert critical_graph(A).arcs == ()
    assert (cyclicity(A), transient(A)) == (1, 3)


def test_classes_of_different_means_have_no_common_transient():
    with pytest.raises(InvalidInputError, match=r"circuit means from 3.0 to 4.0"):
        transient([[3.0, E], [2.0, 4.0]])


def test_rounding_parts_no_circuits_that_tie():
    """0.1 + 0.2 and 0.3 twice over: as floats the means differ in the last digit."""
    A = np.full((3, 3), E)
    A[1, 0], A[0, 1], A[2, 2] = 0.1, 0.2, 0.15
    A[2, 0] = A[0, 2] = -1.0
    assert critical_graph(A).nodes == (0, 1, 2)
    assert critical_graph(exact(A)).nodes != (0, 1, 2)
    thirds = exact([[E, Fraction(1, 3), -1], [Fraction(2, 3), E, E], [-1, E, Fraction(1, 2)]])
    assert critical_graph(thirds).nodes == (0, 1, 2)


@pytest.mark.parametrize("storage", [np.array, exact])
def test_the_transient_of_a_near_tie_of_two_to_the_minus_thirty(storage):
    """Loops of 1 and 1 - 2^-30 with a bridge of -5 each way: the second is forgotten after 12 * 2^30 steps."""
    A = storage([[1.0, -5.0], [-5.0, 1.0 - 2.0**-30]])
    assert transient(A, max_steps=2**34) == 12 * 2**30
    with pytest.raises(IterationLimitError, match="1000000"):
        transient(A)


def test_a_mean_that_is_no_float_makes_no_transient():
    assert (cyclicity([[E, -1.2], [-0.2, E]]), transient([[E, -1.2], [-0.2, E]])) == (2, 0)
    thirds = [[E, E, 0.1], [0.2, E, E], [E, 0.7, E]]
    assert (cyclicity(thirds), transient(thirds)) == (3, 0)


@given(whole_matrices(most=4), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_the_transient_does_not_change_with_units_and_potentials(A, seed):
    """Tenths of whole numbers, moved by potentials: floats that tie only in theory.

    The examples are always the same, because the floats of a transient of some dozen steps may miss a tie by more than
    the comparison allows for: one such matrix has 36 with floats and 34 with fractions.
    """
    A = np.where(A == E, -8.0, A)
    p = np.random.default_rng(seed).integers(-50, 50, len(A)) / 10
    assert transient(0.1 * A + p[:, None] - p) == transient(exact(A))


def test_twenty_thousand_loops_are_as_many_components():
    n = 20_000
    found = critical_graph(rows_of((n, n), np.arange(n), np.arange(n), np.zeros(n)))
    assert (len(found.components), found.cyclicity) == (n, 1)
