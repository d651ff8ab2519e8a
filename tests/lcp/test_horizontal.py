import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError
from pricing_core.lcp import (
    LCP,
    ExtendedHorizontalLCP,
    HorizontalLCP,
    column_w_violation,
    has_column_w_property,
    is_p_matrix,
    solve,
    solve_extended_horizontal,
    solve_horizontal,
)
from tests.lcp.rational_reference import has_solution


def test_with_the_identity_it_is_an_lcp():
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
    found = solve_horizontal(HorizontalLCP(np.eye(2), M, q))
    assert found.z == pytest.approx(solve(LCP(M, q)).z)
    assert found.residual < 1e-12


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 100_000), st.integers(1, 5))
def test_any_column_representative_leads_to_the_solution(seed, n):
    """w = P z + q with rows mixed and some pairs traded, so that neither matrix need be regular."""
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(n, n))
    P, q = N @ N.T + 0.1 * np.eye(n) + (N - N.T), rng.normal(size=n)
    known = solve(LCP(P, q))
    mix = np.eye(n) + 0.3 * rng.normal(size=(n, n)) / n
    traded = rng.random(n) < 0.5
    left, right = np.where(traded, -P, np.eye(n)), np.where(traded, -np.eye(n), P)
    found = solve_horizontal(HorizontalLCP(mix @ left, mix @ right, mix @ q))
    w, z = np.where(traded, known.z, known.w), np.where(traded, known.w, known.z)
    assert found.w == pytest.approx(w, abs=1e-8)
    assert found.z == pytest.approx(z, abs=1e-8)


def test_where_every_complementary_matrix_is_singular_that_is_said():
    n = 21
    ones = np.ones((n, n))
    with pytest.raises(NumericalError, match="singular"):
        solve_horizontal(HorizontalLCP(ones, ones, np.ones(n)))


def test_a_small_problem_needs_no_nonsingular_complementary_matrix():
    problem = HorizontalLCP([[1, 1], [1, 1]], [[1, 1], [1, 1]], [1, 1])
    found = solve_horizontal(problem)
    assert found.residual == 0.0
    with pytest.raises(InfeasibleError):
        solve_horizontal(HorizontalLCP(problem.M, problem.N, [1, 2]))
    with pytest.raises(InfeasibleError):
        solve_horizontal(HorizontalLCP(problem.M, -problem.M, [-1, -1]))


@pytest.mark.parametrize("exponent", [0, -10, -30, 30])
def test_random_whole_numbers_are_solved_or_refused_as_all_cells_say(exponent: int) -> None:
    rng = np.random.default_rng(7)
    counts = {True: 0, False: 0}
    for _ in range(150):
        n = int(rng.integers(1, 4))
        M, N = rng.integers(-3, 4, (2, n, n)) * (rng.random((2, n, n)) < 0.7)
        q = rng.integers(-3, 4, n)
        rows = 2.0 ** (exponent * rng.integers(0, 2, n))
        problem = HorizontalLCP(rows[:, None] * M, rows[:, None] * N, rows * q)
        solvable = has_solution(problem.M, problem.N, problem.q)
        counts[solvable] += 1
        if solvable:
            found = solve_horizontal(problem)
            sizes = np.abs(problem.M) @ found.w + np.abs(problem.N) @ found.z + np.abs(problem.q)
            assert (np.abs(problem.M @ found.w - problem.N @ found.z - problem.q) <= 1e-12 * sizes).all()
            assert min(found.w.min(), found.z.min()) >= 0.0
            assert not (found.w * found.z).any()
        else:
            with pytest.raises(InfeasibleError):
                solve_horizontal(problem)
    assert min(counts.values()) > 20


@pytest.mark.parametrize(
    ("M", "N", "q", "z"),
    [
        ([[-3, 0], [-2, 0]], [[-1, 3], [0, 0]], [3, 0], (3.0, 0.0)),
        ([[0, -2], [0, 3]], [[-2, -1], [3, 0]], [-3, -2], None),
    ],
)
def test_what_the_exchanged_problem_says_is_checked_on_the_given_one(M, N, q, z):
    problem = HorizontalLCP(M, N, q)
    if z is None:
        with pytest.raises(InfeasibleError):
            solve_horizontal(problem)
    else:
        np.testing.assert_allclose(solve_horizontal(problem).z, z)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 100_000), st.integers(1, 3), st.integers(2, 4))
def test_the_w_property_goes_with_one_solution(seed, n, m):
    """Blocks D_j with the signs of C_0 column by column, dominated by their diagonals, have it."""
    rng = np.random.default_rng(seed)
    blocks = [np.diag(rng.uniform(0.5, 2.0, n)) + 0.1 * rng.uniform(-1, 1, (n, n)) for _ in range(m + 1)]
    assert has_column_w_property(blocks)
    q, bounds = rng.normal(size=n) * 3, [rng.uniform(0.1, 1.0, n) for _ in range(m - 1)]
    found = solve_extended_horizontal(ExtendedHorizontalLCP(blocks, q, bounds))
    x = found.x
    total = blocks[0] @ x[0] - q - sum(block @ part for block, part in zip(blocks[1:], x[1:], strict=True))
    assert total == pytest.approx(np.zeros(n), abs=1e-9)
    assert min(part.min() for part in x) >= 0.0
    assert np.abs(x[0] * x[1]).max() < 1e-9
    for j, bound in enumerate(bounds, 1):
        assert (x[j] <= bound + 1e-9).all()
        assert np.abs((bound - x[j]) * x[j + 1]).max() < 1e-9


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 100_000), st.integers(1, 4))
def test_with_the_identity_the_w_property_is_the_p_property(seed, n):
    M = np.random.default_rng(seed).integers(-3, 6, (n, n)).astype(float)
    assert has_column_w_property([np.eye(n), M]) == is_p_matrix(M)


def test_scales_neither_overflow_nor_matter():
    assert has_column_w_property([1e-200 * np.eye(2), 1e200 * np.eye(2)])
    assert not has_column_w_property([1e-200 * np.eye(2), -1e200 * np.eye(2)])
    rng = np.random.default_rng(3)
    for _ in range(40):
        n = int(rng.integers(1, 4))
        blocks = rng.integers(-2, 3, (2, n, n)) + 3.0 * np.eye(n)
        rows, columns = 2.0 ** rng.integers(-200, 201, (2, n))
        scaled = [rows[:, None] * block * columns for block in blocks]
        assert has_column_w_property(scaled) == has_column_w_property(blocks)


def test_a_violation_names_the_columns():
    assert column_w_violation([np.eye(2), [[-1, 0], [0, 1]]]) == (1, 0)
    assert column_w_violation([np.zeros((2, 2)), np.eye(2)]) == (0, 0)
    near = [[1.0, 1.0], [1.0, 1.0 + 1e-13]]
    assert column_w_violation([near, near]) is None  # decided exactly
    assert column_w_violation([[[1.0, 1.0], [1.0, 1.0]]]) == (0, 0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ExtendedHorizontalLCP([np.eye(2)], [1, 1]), "two matrices"),
        (lambda: ExtendedHorizontalLCP([np.eye(2)] * 3, [1, 1]), "bounds"),
        (lambda: ExtendedHorizontalLCP([np.eye(2)] * 3, [1, 1], [[1, 0]]), r"bounds\[0\].*positive"),
        (lambda: HorizontalLCP(np.eye(2), np.eye(3), [1, 1]), "N"),
        (lambda: has_column_w_property([]), "blocks"),
        (lambda: has_column_w_property([np.eye(40)] * 2), "combinations"),
        (lambda: has_column_w_property([np.eye(2000)] * 2), "combinations"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(InvalidInputError, match=message):
        make()
