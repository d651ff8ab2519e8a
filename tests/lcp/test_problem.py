"""The problem and its residuals: what is taken, what is refused, what is measured."""

import numpy as np
import pytest
from scipy.sparse import coo_array, csc_matrix, csr_array

from pricing_core.errors import InvalidInputError
from pricing_core.lcp import LCP, enumerate_solutions, natural_residual, scaled_residual, solve
from pricing_core.lcp.solve import METHODS
from pricing_core.linalg import Tridiagonal


@pytest.mark.parametrize(
    ("M", "q", "field"),
    [
        ([[1.0, 2.0]], [1.0], "M"),
        ([1.0], [1.0], "M"),
        ([[np.nan]], [1.0], "M"),
        ([[1j]], [1.0], "M"),
        ("text", [1.0], "M"),
        (csr_array(np.ones((2, 3))), [1.0, 1.0], "M"),
        (csr_array([[np.inf]]), [1.0], "M"),
        (csr_array([[1j]]), [1.0], "M"),
        ([[1.0]], [1.0, 2.0], "q"),
        ([[1.0]], [np.inf], "q"),
        ([[1.0]], 1.0, "q"),
        (Tridiagonal([], [1.0], []), [1.0, 2.0], "q"),
    ],
)
def test_bad_data_are_refused_by_name(M: object, q: list[float], field: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        LCP(M, q)
    assert caught.value.field == field


def test_the_problem_keeps_its_own_data() -> None:
    M, q = np.eye(2), np.array([-1.0, -2.0])
    sparse = csr_array(M)
    problems = LCP(M, q), LCP(sparse, q)
    M[0, 0], q[0], sparse.data[0] = 9.0, 9.0, 9.0
    for problem in problems:
        np.testing.assert_array_equal(problem.dense(), np.eye(2))
        np.testing.assert_array_equal(problem.q, [-1.0, -2.0])


def test_every_storage_gives_the_same_numbers() -> None:
    T = Tridiagonal([-1.0, -3.0], [2.0, 0.0, 5.0], [1.0, -7.0])
    q, z = np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.0, 2.0])
    stored = [
        LCP(M, q) for M in (T, T.dense(), csr_array(T.dense()), csc_matrix(T.dense()), coo_array(T.dense()))
    ]
    for problem in stored:
        np.testing.assert_allclose(problem.slack(z), T.dense() @ z + q, atol=1e-15)
        assert natural_residual(problem, z) == natural_residual(stored[0], z)
        assert scaled_residual(problem, z) == pytest.approx(scaled_residual(stored[0], z), rel=1e-15)


@pytest.mark.parametrize(
    ("z", "expected"),
    [([1.0, 0.0], 0.0), ([0.0, 0.0], 3.0), ([1.5, 0.0], 1.5), ([-1.0, 0.0], 6.0)],
)
def test_the_natural_residual_is_the_largest_min_of_z_and_w(z: list[float], expected: float) -> None:
    # w = (3 z_0 - 3, z_1 + 1): the solution is (1, 0).
    assert natural_residual(LCP([[3.0, 0.0], [0.0, 1.0]], [-3.0, 1.0]), np.array(z)) == expected


def test_the_scaled_residual_does_not_see_units() -> None:
    random = np.random.default_rng(0)
    M, q, z = random.normal(size=(4, 4)), random.normal(size=4), random.uniform(size=4)
    row, column = 10.0 ** random.uniform(-9.0, 9.0, (2, 4))
    scaled = LCP(row[:, None] * M * column, row * q)
    expected = scaled_residual(LCP(M, q), z)
    assert expected > 0.01
    assert scaled_residual(scaled, z / column) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_the_empty_problem_has_the_empty_solution(method: str) -> None:
    solution = solve(LCP(np.zeros((0, 0)), []), method=method)  # type: ignore[arg-type]
    assert solution.z.shape == solution.w.shape == (0,)
    assert solution.residual == 0.0


def test_the_empty_problem_has_exactly_one_solution() -> None:
    found = enumerate_solutions(LCP(np.zeros((0, 0)), []))
    assert len(found.isolated) == 1
    assert found.faces == ()


@pytest.mark.parametrize("method", [method for method in METHODS if method != "enumeration"])
@pytest.mark.parametrize(("q", "z"), [(-9.8, 9.8), (0.0, 0.0), (2.0, 0.0)])
def test_one_unknown_is_enough(method: str, q: float, z: float) -> None:
    solution = solve(LCP([[1.0]], [q]), method=method)  # type: ignore[arg-type]
    assert solution.z[0] == pytest.approx(z, abs=1e-9)
