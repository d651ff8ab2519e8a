"""Matrix classes: named matrices, definitions checked by brute force, certificates, storages."""

from itertools import chain, combinations

import numpy as np
import pytest
from flint import fmpq, fmpq_mat
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from pricing_core.arrays import Matrix
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.linalg import Tridiagonal
from pricing_core.linalg.matrix_classes import (
    is_h_plus_matrix,
    is_m_matrix,
    is_p_matrix,
    is_positive_definite,
    is_z_matrix,
    p_matrix_violation,
    semipositivity_vector,
)
from tests.problems.lcp_problems import PROBLEMS, KnownProblem, fathi, murty_exponential

seeds = st.integers(0, 2**32 - 1)
KOSTREVA = [[1, 2, 0], [0, 1, 2], [2, 0, 1]]


def index_sets(n: int) -> list[tuple[int, ...]]:
    return list(chain.from_iterable(combinations(range(n), k) for k in range(1, n + 1)))


def minor(M: Matrix, indices: tuple[int, ...]) -> float:
    return float(np.linalg.det(M[np.ix_(indices, indices)]))


@pytest.mark.parametrize(
    ("M", "expected"),
    [
        (KOSTREVA, True),
        (fathi(6), True),
        (fathi(20), True),
        (murty_exponential(12), True),
        ([[1, -2], [2, 1]], True),
        ([[1, 2], [2, 1]], False),
        ([[1, -1], [-1, 1]], False),
        (np.ones((2, 2)), False),  # P0, not P
        (np.ones((4, 4)), False),
        ([[0.1, 0.3], [0.3, 0.9]], True),  # as doubles, 0.1 * 0.9 is above 0.3 * 0.3 by 1e-17
        ([[0.1, 0.3], [0.3, 0.8999999999999998]], False),
        ([[-1.0]], False),
        (np.zeros((0, 0)), True),
    ],
)
def test_the_p_property_of_named_matrices(M: ArrayLike, expected: bool) -> None:
    assert is_p_matrix(M) is expected


@given(st.integers(1, 5), seeds)
@settings(max_examples=200, deadline=None)
def test_the_p_property_of_integer_matrices_is_that_of_all_minors(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = random.integers(-3, 4, (n, n)).astype(np.float64) + 2.0 * np.eye(n)
    violation = p_matrix_violation(M)
    # Minors of integer matrices are integers: 0.5 tells positive from nonpositive.
    assert (violation is None) == all(minor(M, indices) > 0.5 for indices in index_sets(n))
    if violation is not None:
        assert minor(M, violation) < 0.5


def cyclic(n: int, entry: float) -> Matrix:
    """Return I + entry C with C the cyclic shift: det = 1 - (-entry)**n, all smaller principal minors 1."""
    return np.eye(n) + entry * np.roll(np.eye(n), 1, axis=1)


@pytest.mark.parametrize("n", [3, 5, 11, 17])
def test_the_one_nonpositive_minor_of_a_cycle_is_found(n: int) -> None:
    assert p_matrix_violation(cyclic(n, 2.0)) is None
    assert p_matrix_violation(cyclic(n, -2.0)) == tuple(range(n))
    assert p_matrix_violation(cyclic(n, -1.0)) == tuple(range(n))


def test_beyond_the_largest_order_the_question_is_left_open_unless_a_quick_test_decides() -> None:
    assert is_p_matrix(fathi(60))
    assert not is_p_matrix(-np.eye(60))
    with pytest.raises(IterationLimitError, match="21"):
        is_p_matrix(cyclic(21, 2.0))


@given(st.integers(1, 6), seeds)
@settings(max_examples=100, deadline=None)
def test_a_z_matrix_is_an_m_matrix_iff_its_inverse_is_nonnegative(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = -random.uniform(0.0, 1.0, (n, n))
    np.fill_diagonal(M, random.uniform(0.1, n, n))
    assert is_z_matrix(M)
    assert is_m_matrix(M) == bool((np.linalg.inv(M) >= 0.0).all())
    signs = np.where(random.uniform(size=(n, n)) < 0.5, -1.0, 1.0)
    np.fill_diagonal(signs, 1.0)
    assert is_h_plus_matrix(signs * M) == is_m_matrix(M)


@pytest.mark.parametrize("problem", PROBLEMS, ids=str)
def test_the_zoo_is_labelled_rightly(problem: KnownProblem) -> None:
    M = problem.lcp.dense()
    assert is_p_matrix(M) == ("P" in problem.classes)
    assert is_m_matrix(M) == ("M" in problem.classes)
    assert is_h_plus_matrix(M) == ("H+" in problem.classes)
    assert is_positive_definite(M) == ("positive definite" in problem.classes)


def test_all_storages_give_one_answer() -> None:
    T = Tridiagonal([-1.0, 0.5], [2.0, 2.0, 2.0], [-0.5, -1.0])
    for function, expected in (
        (is_z_matrix, False),
        (is_m_matrix, False),
        (is_h_plus_matrix, True),
        (is_p_matrix, True),
    ):
        for M in (T, T.dense(), csr_array(T.dense())):
            assert function(M) is expected
    string = Tridiagonal([-1.0, -1.0], [2.0, 2.0, 2.0], [-1.0, -1.0])
    for M in (string, string.dense(), csr_array(string.dense())):
        assert is_z_matrix(M)
        assert is_m_matrix(M)
        x = semipositivity_vector(M)
        assert x is not None
        np.testing.assert_allclose(x, [3.0, 4.0, 3.0])  # M x = diag(M) = 2


def test_a_singular_m_matrix_is_not_accepted_in_any_storage() -> None:
    string = Tridiagonal([-1.0, -1.0], [1.0, 2.0, 1.0], [-1.0, -1.0])
    for M in (string, string.dense(), csr_array(string.dense())):
        assert not is_m_matrix(M)


def test_units_of_rows_and_columns_do_not_matter() -> None:
    row, column = np.array([1e-12, 1e9, 1.0]), np.array([1e10, 1e-11, 1e3])
    scale = row[:, None] * column
    assert is_p_matrix(scale * KOSTREVA)
    assert not is_p_matrix(scale * np.ones((3, 3)) * [[1, 1, 0], [1, 0.5, 0], [0, 0, 1]])
    assert is_m_matrix(row[:, None] * [[2, -1, 0], [-1, 2, -1], [0, -1, 2]])


@pytest.mark.parametrize("M", [[[1.0, 2.0]], [[np.nan]], csr_array(np.ones((1, 2))), [["a"]]])
def test_matrices_that_are_none_are_refused(M: object) -> None:
    with pytest.raises(InvalidInputError):
        is_p_matrix(M)


def test_the_p_property_of_nearly_singular_matrices_is_that_of_exact_minors() -> None:
    """Dependent columns, changed by 1e-17 to 1e-5 of themselves, with rows and columns of any scale."""
    counts = {True: 0, False: 0}
    for seed in range(400):
        random = np.random.default_rng(seed)
        n = int(random.integers(2, 6))
        A = random.integers(-2, 5, (n, n)) + 2.0 * np.eye(n)
        if random.random() < 0.7:
            k = int(random.integers(1, n))
            A[:, -1] = A[:, :k] @ random.integers(0, 3, k)
        A = A * (1.0 + 10.0 ** random.uniform(-17.0, -5.0) * random.normal(size=(n, n)))
        if random.random() < 0.3:
            A = A * 10.0 ** random.uniform(-90.0, 90.0, (n, 1)) * 10.0 ** random.uniform(-9.0, 9.0, (1, n))
        rows = [[fmpq(*value.as_integer_ratio()) for value in row] for row in A.tolist()]

        def minor(chosen: tuple[int, ...], rows: list[list[fmpq]] = rows) -> fmpq:
            return fmpq_mat([[rows[i][j] for j in chosen] for i in chosen]).det()

        sets = [chosen for size in range(1, n + 1) for chosen in combinations(range(n), size)]
        violation = p_matrix_violation(A)
        assert (violation is None) == all(minor(chosen) > 0 for chosen in sets)
        assert violation is None or minor(violation) <= 0
        counts[violation is None] += 1
    assert min(counts.values()) > 40


@pytest.mark.parametrize(
    ("M", "expected"),
    [
        ([[1, 3, 0], [1, 3.000001, -1e-6], [3, 8.999999998, 2e-9]], False),
        ([[1, 1, 0], [1, 1.0000001, -9.5e-11], [2, 1.9999998, 1.9e-10]], True),
    ],
)
def test_pivots_after_a_tiny_one_are_not_trusted(M: ArrayLike, expected: bool) -> None:
    assert is_p_matrix(M) is expected
