"""Eigenvalues three ways: Howard, Karp and all simple circuits."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import (
    cycle_ratio,
    cycle_time,
    eigenvalue,
    eigenvalues,
    exact,
    multiply,
    power,
    sparse,
)
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.matrices import rows_of
from pricing_core.max_plus.spectrum import mean_of_circuits
from tests.problems.max_plus_problems import KNOWN, E, simple_circuits, whole_matrices


def brute_force(A):
    return max((Fraction(int(weight), len(nodes)) for weight, nodes in simple_circuits(A)), default=E)


@pytest.mark.parametrize("known", KNOWN, ids=str)
@pytest.mark.parametrize("method", ["howard", "karp"])
@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_the_eigenvalue_of_known_matrices(known, method, storage):
    found = eigenvalue(storage(known.A), method=method)
    assert found == known.eigenvalue
    assert isinstance(found, Fraction) == (storage is exact)


@given(whole_matrices())
@settings(max_examples=150, deadline=None)
def test_howard_karp_and_all_simple_circuits_agree(A):
    expected = brute_force(A)
    for method in ("howard", "karp"):
        assert eigenvalue(exact(A), method=method) == expected
        assert eigenvalue(A, method=method) == pytest.approx(float(expected), abs=1e-14)
        assert eigenvalue(sparse(A) if (A != E).any() else A, method=method) == eigenvalue(A, method=method)


@given(whole_matrices(), st.integers(0, 2**32 - 1), st.integers(-9, 9), st.integers(1, 5))
@settings(max_examples=80, deadline=None)
def test_the_spectrum_does_not_change_with_the_labels_and_moves_with_the_units(A, seed, shift, factor):
    A, order = exact(A), np.random.default_rng(seed).permutation(len(A))
    expected = eigenvalues(A)
    np.testing.assert_array_equal(eigenvalues(A[np.ix_(order, order)]), expected)
    np.testing.assert_array_equal(eigenvalues(A + shift), expected + shift)
    np.testing.assert_array_equal(eigenvalues(A * factor), expected * factor)
    offset = exact(np.random.default_rng(seed).integers(-50, 50, len(A)))
    np.testing.assert_array_equal(eigenvalues(A + offset[:, None] - offset), expected)


@given(st.integers(2, 40), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_howard_and_karp_agree_for_larger_matrices_of_floats(n, seed):
    random = np.random.default_rng(seed)
    A = np.where(random.random((n, n)) < 3.0 / n, 1e3 * random.normal(size=(n, n)), E)
    assert eigenvalue(A) == pytest.approx(eigenvalue(A, method="karp"), rel=1e-12, abs=1e-12)


@given(whole_matrices())
@settings(max_examples=80, deadline=None)
def test_the_potential_of_howard_proves_its_ratio(A):
    graph = arcs_of(exact(A))
    solution = mean_of_circuits(graph)
    inner = solution.label[graph.head] == solution.label[graph.tail]
    head, tail = graph.head[inner], graph.tail[inner]
    x = solution.potential
    assert (graph.weight[inner] - solution.ratio[head] + x[tail] <= x[head]).all()


@given(whole_matrices(most=4))
@settings(max_examples=120, deadline=None)
def test_the_eigenvalues_are_the_means_of_the_circuits_that_no_heavier_one_hears_from(A):
    """A mean is one if no circuit to which a path leads from its own has a larger one; found by trying all."""
    A = exact(A)
    n = len(A)
    reach = np.linalg.matrix_power(np.eye(n, dtype=int) + (A != E), n) > 0
    circuits = [(Fraction(w, len(nodes)), nodes) for w, nodes in simple_circuits(A)]
    expected = set()
    for mean, nodes in circuits:
        hearing = reach[:, nodes[0]]
        if all(other <= mean for other, those in circuits if hearing[those[0]]):
            expected.add(mean)
    if (A == E).all(axis=0).any():
        expected.add(E)
    assert eigenvalues(A).tolist() == sorted(expected, reverse=True)


def test_a_vector_of_cycle_times_need_be_no_eigenvalue():
    """Baccelli et al.: [[3, eps], [2, 4]] has the cycle-time vector (3, 4) and no eigenvector for 3."""
    A = [[3.0, E], [2.0, 4.0]]
    np.testing.assert_array_equal(cycle_time(A), [3.0, 4.0])
    np.testing.assert_array_equal(eigenvalues(A), [4.0])


@given(whole_matrices())
@settings(max_examples=80, deadline=None)
def test_the_cycle_time_is_the_growth_of_the_orbit(A):
    """(x(2k) - x(k)) / k for k a multiple of all circuit lengths, after the transient."""
    A, k = exact(A), 60 * 12
    x0 = exact(np.zeros(len(A)))
    early, late = multiply(power(A, k), x0), multiply(power(A, 2 * k), x0)
    growth = [E if b == E else (b - a) / k for a, b in zip(early, late, strict=True)]
    assert cycle_time(A).tolist() == growth


@given(whole_matrices(), st.integers(0, 2**32 - 1))
@settings(max_examples=120, deadline=None)
def test_the_cycle_ratio_is_the_largest_over_all_simple_circuits(A, seed):
    holding = np.random.default_rng(seed).integers(1, 5, A.shape)
    ratios = [
        Fraction(int(weight), int(sum(holding[h, t] for t, h in zip(c, c[1:] + c[:1], strict=True))))
        for weight, c in simple_circuits(A)
    ]
    expected = max(ratios, default=E)
    assert cycle_ratio(exact(A), exact(holding)) == expected
    assert cycle_ratio(A, holding) == pytest.approx(float(expected), abs=1e-14)


def test_a_circuit_without_holding_is_named():
    with pytest.raises(InvalidInputError, match="positive somewhere on the circuit 0 -> 2 -> 0"):
        cycle_ratio([[E, E, 1.0], [1.0, E, E], [1.0, 1.0, E]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    "holding", [[[-1.0]], [[np.inf]], [[1.0, 2.0]], [[1.0, 1.0], [1.0, 1.0]], [[np.nan]]]
)
def test_a_holding_that_is_none_is_refused(holding):
    with pytest.raises(InvalidInputError) as caught:
        cycle_ratio([[1.0]], holding)
    assert caught.value.field == "holding"


@pytest.mark.parametrize("call", [eigenvalue, eigenvalues, cycle_time])
def test_top_has_no_meaning_in_a_spectrum(call):
    for A in ([[np.inf]], sparse([[np.inf]])):
        with pytest.raises(InvalidInputError, match="inf has no meaning here"):
            call(A)


def test_an_unknown_method_is_refused():
    with pytest.raises(InvalidInputError, match="howard"):
        eigenvalue([[1.0]], method="power")


def test_howard_ends_on_a_circuit_of_thousands_of_arcs():
    """Found by the benchmark: potentials that miss their equation by rounding seemed to gain for ever."""
    random, n = np.random.default_rng(10_000), 10_000
    number = np.arange(n)
    head, tail = np.concatenate([np.roll(number, -1), np.roll(number, -2)]), np.tile(number, 2)
    solution = mean_of_circuits(arcs_of(rows_of((n, n), head, tail, random.normal(size=2 * n))))
    assert solution.iterations < 30
    assert solution.error.max() < 1e-10


def test_howard_takes_a_graph_of_ten_thousand_nodes_with_a_known_answer():
    """A ring of 0.5 and 1.5 in turn, among random arcs below 0.5: after 1.5 there is no arc above 0.5."""
    n = 10_000
    random = np.random.default_rng(7)
    head = np.concatenate([random.integers(0, n, 9 * n), np.roll(np.arange(n), -1)])
    tail = np.concatenate([random.integers(0, n, 9 * n), np.arange(n)])
    weight = np.concatenate([random.uniform(0.0, 0.499, 9 * n), np.tile([0.5, 1.5], n // 2)])
    assert eigenvalue(rows_of((n, n), head, tail, weight)) == 1.0


BLOCK = [[3.0, 7.0], [2.0, 4.0]]  # its largest mean is 4.5


@pytest.mark.parametrize("far", [1e3, 1e14, 1e16, 1e40])
def test_a_small_block_among_large_weights_sets_the_pace(far):
    A = np.full((20, 20), -far)
    A[np.ix_([5, 9], [5, 9])] = BLOCK
    assert eigenvalue(A) == 4.5
    A[0, 0], A[17, 17] = 1.0, 4.25
    assert eigenvalue(A) == 4.5


@pytest.mark.parametrize("far", [1e14, 1e16, 1e40])
def test_a_block_behind_a_large_weight_and_before_its_opposite_sets_the_pace(far):
    """The potential of the block is `far`, beside which its own weights are lost."""
    A = np.full((4, 4), E)
    A[0, 0], A[1, 0], A[0, 2] = 5.0, far, -far
    A[1:3, 1:3] = [[3.0, 7.0], [4.0, 4.0]]
    A[3, 0] = A[0, 3] = A[3, 3] = 1.0
    assert eigenvalue(A) == 5.5


def test_each_class_is_rounded_by_its_own_weights():
    A = np.full((4, 4), E)
    A[:2, :2] = BLOCK
    A[2:, 2:] = [[1e14, 1e14 + 2.0], [1e14 - 4.0, 1e14]]
    np.testing.assert_array_equal(cycle_time(A), [4.5, 4.5, 1e14, 1e14])
    np.testing.assert_array_equal(eigenvalues(A), [1e14, 4.5])


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_floats_of_very_different_sizes_have_the_eigenvalue_of_the_numbers_that_they_are(n, seed):
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n)) * 10.0 ** random.integers(-17, 18, (n, n))
    expected, found = eigenvalue(exact(A)), Fraction(eigenvalue(A))
    assert abs(found - expected) <= Fraction(8 * 2.0**-52) * max(map(abs, exact(A).flat))
    circuits = [(Fraction(w) / len(c), c) for w, c in simple_circuits(exact(A).tolist())]
    best = next(c for mean, c in circuits if mean == expected)
    size = max(abs(A[head, tail]) for tail, head in zip(best, best[1:] + best[:1], strict=True))
    assert abs(found - expected) <= 8 * 2.0**-52 * max(size, np.abs(A).min())


@pytest.mark.parametrize("rising", [True, False])
def test_a_chain_of_thousands_of_classes_is_swept_once(rising):
    """Loops of 0 ... n - 1 or n ... 1, each before the next: a node's is the largest so far."""
    n = 3000
    i = np.arange(n)
    loops = i if rising else n - i
    chain = rows_of(
        (n, n), np.append(i, i[1:]), np.append(i, i[:-1]), np.append(loops, np.zeros(n - 1)).astype(float)
    )
    np.testing.assert_array_equal(cycle_time(chain), loops if rising else np.full(n, n))
    np.testing.assert_array_equal(eigenvalues(chain), [n - 1] if rising else n - i)
