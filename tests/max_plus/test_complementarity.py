"""Max-plus and complementarity: direct evaluation and LCPs give the same; Howard here is Howard there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.lcp import (
    LCP,
    enumerate_solutions,
    is_p_matrix,
    natural_residual,
    solve,
    solve_lemke,
    solve_murty,
    solve_policy_iteration,
)
from pricing_core.max_plus import (
    Expression,
    MaxMinPlusScalingSystem,
    VerticalLCP,
    as_lcp,
    fixed_point_problem,
    largest,
    least,
    least_solution,
    multiply,
    simulate,
    solve_vertical,
    variables,
)
from tests.problems.max_plus_problems import KNOWN, E, whole_matrices

seeds = st.integers(0, 2**32 - 1)
PAIR = MaxMinPlusScalingSystem([largest(*variables(2))], inputs=1)
SOLVERS = [solve, solve_lemke, solve_murty]


@pytest.mark.parametrize("known", [k for k in KNOWN if k.orbit], ids=str)
@pytest.mark.parametrize("solver", SOLVERS)
def test_complementarity_gives_the_orbits_of_the_literature(known, solver):
    x = np.array(known.orbit[0], dtype=float)
    for expected in known.orbit[1:]:
        step = as_lcp(known.A, x)
        assert is_p_matrix(step.problem.M)
        solution = solver(step.problem)
        x = step.following(solution.z)
        np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-12)


@given(whole_matrices(), seeds)
@settings(max_examples=60, deadline=None)
def test_a_product_is_the_solution_of_its_complementarity_problem(A, seed):
    A = np.where((A == E).all(axis=1)[:, None], 1.0, A)
    x = np.random.default_rng(seed).normal(size=len(A))
    step = as_lcp(A, x)
    assert step.problem.size == (A != E).sum() - len(A)
    np.testing.assert_allclose(step.following(solve(step.problem).z), multiply(A, x), rtol=0.0, atol=1e-12)


def test_the_maximum_of_two_numbers_is_1166_with_b_at_least_0():
    """z = x + a = y + b, 0 <= a _|_ b >= 0. With b <= 0, as (11.67) is printed, x = 3, y = 1 has no z."""
    for x, y in [(3.0, 1.0), (1.0, 3.0), (2.0, 2.0)]:
        step = as_lcp([[x, y]], [0.0, 0.0])
        np.testing.assert_array_equal(step.problem.dense(), [[1.0]])
        np.testing.assert_array_equal(step.problem.q, [x - y])
        (only,) = enumerate_solutions(step.problem).isolated
        assert step.following(only.z)[0] == max(x, y)
        assert only.z[0] * only.w[0] == 0.0


@st.composite
def expressions(draw, size, depth=3):
    """Draw an expression of `size` variables."""
    if depth == 0 or draw(st.integers(0, 3)) == 0:
        return variables(size)[draw(st.integers(0, size - 1))] + float(draw(st.integers(-5, 5)))
    parts = [draw(expressions(size, depth - 1)) for _ in range(draw(st.integers(1, 3)))]
    kind = draw(st.sampled_from(["largest", "least", "sum"]))
    if kind == "largest":
        return largest(*parts)
    if kind == "least":
        return least(*parts)
    total = parts[0] * 0.5
    for part in parts[1:]:
        total = total - part * draw(st.sampled_from([-1.0, 0.25, 2.0]))
    return total


@given(st.lists(expressions(3), min_size=2, max_size=2), seeds)
@settings(max_examples=100, deadline=None)
def test_a_max_min_plus_scaling_system_and_its_complementarity_system_run_together(rows, seed):
    random = np.random.default_rng(seed)
    system = MaxMinPlusScalingSystem(rows, inputs=1)
    twin = system.complementarity()
    if len(twin.g):
        np.testing.assert_array_equal(np.triu(twin.D), np.eye(len(twin.g)))
    direct = complementary = random.normal(size=2)
    for _ in range(4):
        u = random.normal(size=1)
        direct = system.step(np.concatenate([direct, u]))
        complementary = twin.step(np.concatenate([complementary, u]))
        np.testing.assert_allclose(complementary, direct, rtol=1e-9, atol=1e-9 * (1 + np.abs(direct).max()))


def test_a_max_plus_system_is_a_max_min_plus_scaling_system():
    x = variables(2)
    system = MaxMinPlusScalingSystem([largest(3.0 + x[0], 7.0 + x[1]), largest(2.0 + x[0], 4.0 + x[1])])
    state = np.array([1.0, 0.0])
    for expected in simulate(KNOWN[0].A, state, 5).x[1:]:
        state = system.complementarity().step(state)
        np.testing.assert_allclose(state, expected, rtol=0.0, atol=1e-12)


def negative_circuits(random, n):
    return np.where(random.random((n, n)) < 0.6, -random.integers(1, 9, (n, n)), E).astype(float)


@given(st.integers(1, 8), seeds)
@settings(max_examples=60, deadline=None)
def test_the_vertical_problem_has_the_least_solution_of_x_equals_a_x_plus_b(n, seed):
    random = np.random.default_rng(seed)
    A, b = negative_circuits(random, n), random.integers(-20, 20, n).astype(float)
    found = solve_vertical(fixed_point_problem(A, b))
    np.testing.assert_allclose(found.x, least_solution(A, b), rtol=0.0, atol=1e-12)
    assert found.iterations <= n + 1


@given(st.integers(2, 12), seeds)
@settings(max_examples=60, deadline=None)
def test_stopping_on_a_path_is_one_problem_for_the_lcp_and_for_the_max_plus_iteration(n, seed):
    """V = max(g, c + V of the next node): the option's problem without discount, x = A x + b with one arc per row."""
    random = np.random.default_rng(seed)
    following = [int(random.integers(i + 1, n)) if i < n - 1 else None for i in range(n)]
    cost, payoff = -random.integers(0, 5, n).astype(float), random.integers(0, 20, n).astype(float)
    A, P = np.full((n, n), E), np.zeros((n, n))
    for i, j in enumerate(following[:-1]):
        A[i, j], P[i, j] = cost[i], 1.0
    M = np.eye(n) - P
    continued = np.where(np.arange(n) < n - 1, cost, 0.0)
    q = M @ payoff - continued
    q[-1] = 0.0  # the last node has no next one: it stops
    problem = LCP(M, q)
    by_lcp = solve_policy_iteration(problem, start=np.zeros(n, dtype=bool))
    by_rows = solve_vertical(fixed_point_problem(A, payoff))
    np.testing.assert_allclose(by_lcp.z + payoff, least_solution(A, payoff), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(by_rows.x, by_lcp.z + payoff, rtol=0.0, atol=1e-12)
    assert by_lcp.iterations == by_rows.iterations


@given(st.integers(1, 6), seeds)
@settings(max_examples=40, deadline=None)
def test_an_lcp_is_a_vertical_problem_with_two_rows_in_each_group(n, seed):
    random = np.random.default_rng(seed)
    M = -random.uniform(0.0, 1.0, (n, n))
    np.fill_diagonal(M, 1.0 + n)
    q = random.normal(size=n)
    rows = VerticalLCP(np.vstack([np.eye(n), M]), np.concatenate([np.zeros(n), q]), np.tile(np.arange(n), 2))
    found = solve_vertical(rows)
    assert natural_residual(LCP(M, q), found.x) <= 1e-12
    by_lcp = solve_policy_iteration(LCP(M, q), start=np.zeros(n, dtype=bool))
    np.testing.assert_allclose(found.x, by_lcp.z, rtol=0.0, atol=1e-12)


def test_a_policy_whose_own_row_misses_zero_by_rounding_is_not_taken_again():
    """Elimination leaves -1e-33 in the place of a z of zero, whose row has no larger number to be measured by."""
    random = np.random.default_rng(432)
    M = -random.uniform(0.0, 1.0, (6, 6))
    np.fill_diagonal(M, 7.0)
    q = random.normal(size=6)
    rows = VerticalLCP(np.vstack([np.eye(6), M]), np.concatenate([np.zeros(6), q]), np.tile(np.arange(6), 2))
    found = solve_vertical(rows)
    np.testing.assert_array_equal(found.policy, [6, 7, 2, 3, 10, 11])
    assert found.iterations == 3
    np.testing.assert_allclose(found.x, solve_lemke(LCP(M, q)).z, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: as_lcp([[1.0], [E]], [0.0]), InvalidInputError, "row 1 is epsilon"),
        (lambda: as_lcp([[1.0]], [E]), InvalidInputError, "finite"),
        (lambda: as_lcp([[1.0]], [0.0, 1.0]), InvalidInputError, "length 1"),
        (largest, InvalidInputError, "one or more"),
        (lambda: largest("x"), InvalidInputError, "a finite number or an expression"),
        (lambda: MaxMinPlusScalingSystem([]), InvalidInputError, "one for each state"),
        (lambda: MaxMinPlusScalingSystem([variables(2)[1]]), InvalidInputError, "variable 1"),
        (lambda: MaxMinPlusScalingSystem([1.0], inputs=-1), InvalidInputError, "inputs"),
        (lambda: VerticalLCP([[1.0]], [0.0], [1]), InvalidInputError, "group"),
        (lambda: VerticalLCP([[1.0]], [0.0], [0, 0]), InvalidInputError, "group"),
        (
            lambda: fixed_point_problem([[0.0]], [0.0]),
            NumericalError,
            "circuit 0 -> 0 of A has a weight >= 0",
        ),
        (
            lambda: fixed_point_problem([[E, 2.0], [-2.0, E]], [0.0, 0.0]),
            NumericalError,
            "circuit 0 -> 1 -> 0 of A has a weight >= 0",
        ),
        (lambda: PAIR.step([1.0]), InvalidInputError, "v = .* a vector of length 2"),
        (lambda: PAIR.step([1.0, np.inf]), InvalidInputError, "v = .* finite"),
        (lambda: PAIR.complementarity().step([1.0]), InvalidInputError, "v = .* length 2"),
        (lambda: PAIR.complementarity().following([1.0, 2.0], [1.0, 2.0]), InvalidInputError, "a = "),
        (lambda: variables(2)[1].value([1.0]), InvalidInputError, "x = 1 numbers"),
        (lambda: largest(True, 1.0), InvalidInputError, "a finite number or an expression"),
        (lambda: MaxMinPlusScalingSystem(5), InvalidInputError, "expressions = 5"),
        (
            lambda: MaxMinPlusScalingSystem([Expression()]).step([1.0]),
            InvalidInputError,
            "max, min, plus and scaling",
        ),
        (lambda: VerticalLCP([[1.0], [1.0, 2.0]], [0.0], [0]), InvalidInputError, "N = "),
        (
            lambda: solve_vertical(VerticalLCP([[1.0]], [0.0], [0]), max_iterations=0.5),
            InvalidInputError,
            "max",
        ),
    ],
)
def test_what_is_no_such_problem_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_what_expressions_share_is_evaluated_once():
    """x_0 doubled sixty times: 2^60 terms when written out."""
    doubled = variables(1)[0]
    for _ in range(60):
        doubled = doubled + doubled
    assert doubled.value([3.0]) == 3.0 * 2.0**60
    halved = largest(doubled, variables(1)[0]) * 2.0**-60
    system = MaxMinPlusScalingSystem([largest(halved, halved + 1.0)])
    assert system.complementarity().step([3.0]) == system.step([3.0]) == [4.0]
    assert len(system.complementarity().g) == 2


def test_expressions_may_be_nested_deeply():
    deep = variables(1)[0]
    for _ in range(4000):
        deep = least(deep, 1.0) + 1.0
    assert deep.value([-1e5]) == -96_000.0
    assert MaxMinPlusScalingSystem([deep]).step([5.0]) == [2.0]


def test_a_large_time_elsewhere_hides_no_row():
    A = np.full((3, 3), E)
    A[1, 2] = -1.0
    found = solve_vertical(fixed_point_problem(A, [1e16, 0.0, 5.0]))
    np.testing.assert_array_equal(found.x, [1e16, 4.0, 5.0])
