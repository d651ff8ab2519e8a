"""Eigenvectors satisfy their equation, span the eigenspace, and agree with the literature."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse import random_array

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.max_plus import (
    add,
    cycle_time,
    dense,
    eigenmode,
    eigenvalue,
    eigenvalues,
    eigenvector,
    eigenvectors,
    exact,
    multiply,
    sparse,
    star,
)
from pricing_core.max_plus.matrices import rows_of
from tests.problems.max_plus_problems import KNOWN, E, whole_matrices


@pytest.mark.parametrize("known", [k for k in KNOWN if k.eigenvector], ids=str)
@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_the_eigenvector_of_known_matrices(known, storage):
    expected = np.array([float(entry) for entry in known.eigenvector])
    np.testing.assert_array_equal(eigenvector(storage(known.A)).astype(float), expected - expected.max())


@given(whole_matrices())
@settings(max_examples=150, deadline=None)
def test_every_eigenvector_satisfies_its_equation(A):
    A = exact(A)
    for value in eigenvalues(A):
        if value == E:
            continue
        vectors = eigenvectors(A, value)
        for v in vectors.T:
            assert max(v) == 0
            np.testing.assert_array_equal(multiply(A, v), value + v)
        combined = add(vectors[:, 0] + 3, vectors[:, -1])
        np.testing.assert_array_equal(multiply(A, combined), value + combined)


@given(whole_matrices(most=4, density=1.0))
@settings(max_examples=60, deadline=None)
def test_the_columns_are_those_of_the_star_at_critical_nodes(A):
    """A second way to the eigenspace: columns j of B* with (B+)_jj = 0, B = A - lambda."""
    A = exact(np.where(A == E, -9.0, A))
    value = eigenvalue(A)
    closed = star(A - value)
    through = multiply(A - value, closed)
    columns = [closed[:, j] - max(closed[:, j]) for j in range(len(A)) if through[j, j] == 0]
    distinct = {tuple(column) for column in columns}
    assert {tuple(v) for v in eigenvectors(A).T} == distinct


@given(whole_matrices())
@settings(max_examples=100, deadline=None)
def test_the_eigenmode_solves_the_recursion_from_the_start(A):
    A = np.where((A == E).all(axis=1)[:, None] & np.eye(len(A), dtype=bool), 1.0, A)
    for stored in (A, exact(A)):
        mode = eigenmode(stored)
        np.testing.assert_array_equal(mode.cycle_time, cycle_time(stored))
        for k in range(4):
            np.testing.assert_allclose(
                multiply(stored, mode.offset + k * mode.cycle_time).astype(float),
                (mode.offset + (k + 1) * mode.cycle_time).astype(float),
                rtol=0.0,
                atol=0.0 if stored.dtype == object else 1e-12,
            )


def test_float_eigenvectors_of_a_large_sparse_matrix_satisfy_their_equation():
    random = np.random.default_rng(3)
    A = random_array((3000, 3000), density=2e-3, rng=random, format="csr")
    value, v = eigenvalue(A), eigenvector(A)
    finite = v != E
    assert finite.sum() > 2900
    np.testing.assert_array_equal(multiply(A, v) != E, finite)
    np.testing.assert_allclose(multiply(A, v)[finite], (value + v)[finite], rtol=0.0, atol=1e-10)


def test_what_is_no_eigenvalue_is_refused_and_the_eigenvalues_are_told():
    with pytest.raises(InvalidInputError, match="with circuits these are 4"):
        eigenvectors([[3.0, E], [2.0, 4.0]], 3.0)


def test_a_matrix_without_circuits_has_no_eigenvector():
    with pytest.raises(NumericalError, match="no circuit"):
        eigenvector([[E, 1.0], [E, E]])


def test_the_eigenvalue_minus_infinity_has_vectors_of_another_kind():
    assert eigenvalues([[1.0, E], [E, E]]).tolist() == [1.0, E]
    with pytest.raises(InvalidInputError, match="value = -inf: must be finite: only columns of epsilon"):
        eigenvectors([[1.0, E], [E, E]], E)


def test_a_row_of_epsilon_has_no_eigenmode():
    with pytest.raises(InvalidInputError, match="row 1 is epsilon"):
        eigenmode([[1.0, 2.0], [E, E]])


def test_fractions_stay_fractions():
    v = eigenvector(exact(KNOWN[0].A))
    assert all(isinstance(entry, Fraction) for entry in v)
    assert dense(v[:, None]).dtype == object


@pytest.mark.parametrize("chords", ["random", "over one node"])
def test_the_eigenvector_of_a_ring_with_chords_satisfies_its_equation(chords):
    n, random = 20_000, np.random.default_rng(1)
    i = np.arange(n)
    other = random.integers(0, n, n) if chords == "random" else np.roll(i, -2)
    A = rows_of((n, n), np.append(np.roll(i, -1), other), np.append(i, i), random.normal(size=2 * n))
    v = eigenvector(A)
    np.testing.assert_allclose(multiply(A, v), eigenvalue(A) + v, rtol=0.0, atol=1e-11)


def test_eigenvectors_of_a_small_block_beside_a_large_one():
    A = np.full((4, 4), E)
    A[:2, :2] = [[3.0, 7.0], [2.0, 4.0]]
    A[2:, 2:] = [[1e14, 1e14 + 2.0], [1e14 - 4.0, 1e14]]
    np.testing.assert_array_equal(eigenvectors(A, 4.5), [[0.0], [-2.5], [E], [E]])


def test_the_eigenmode_of_a_long_chain_puts_each_class_late_enough():
    """Loops n ... 1 and arcs of 7: x_i(k) = n k + v_i, v falling by n - 7. Loops 1 ... n: each at its own rate."""
    n = 3000
    i = np.arange(n)
    head, tail, bridges = np.append(i, i[1:]), np.append(i, i[:-1]), np.full(n - 1, 7.0)
    mode = eigenmode(rows_of((n, n), head, tail, np.append(n - i, bridges)))
    np.testing.assert_array_equal(mode.cycle_time, np.full(n, n))
    np.testing.assert_array_equal(mode.offset, -i * (n - 7.0))
    mode = eigenmode(rows_of((n, n), head, tail, np.append(1.0 + i, bridges)))
    np.testing.assert_array_equal(mode.cycle_time, 1.0 + i)
    np.testing.assert_array_equal(mode.offset[:8], [0, 5, 9, 12, 14, 15, 15, 14])


def test_the_entries_of_a_far_block_keep_their_distances():
    """Node 0 sets the pace 5; the others are 1e16 later, where floats are 2 apart, and 3 from each other."""
    A = [[5.0, E, -1e16], [1e16, 3.0, 7.0], [E, 2.0, 4.0]]
    np.testing.assert_array_equal(eigenvector(A), [5.0 - 1e16, 0.0, -3.0])
