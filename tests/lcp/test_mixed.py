"""Mixed problems: bounds of every kind and free unknowns, by every method that takes them."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array

from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError, RayTerminationError
from pricing_core.lcp import LCP, MixedLCP, natural_residual, scaled_residual, solve
from pricing_core.lcp.mixed_reduction import eliminated, one_sided, split
from pricing_core.linalg import Tridiagonal

seeds = st.integers(0, 2**32 - 1)
METHODS = ("auto", "block-pivoting", "lemke", "psor", "multigrid", "exact")


def bounds(n, random):
    """Return bounds of every kind: none, one, two, and two equal ones."""
    kind = random.integers(0, 5, n)
    middle, width = random.normal(size=n), random.uniform(0.1, 1.0, n)
    lower = np.where((kind == 0) | (kind == 1), -np.inf, middle - width)
    upper = np.where((kind == 0) | (kind == 2), np.inf, np.where(kind == 4, lower, middle + width))
    return lower, upper


def definite(n, random):
    A = random.normal(size=(n + 3, n))
    return A, A.T @ A


@given(st.integers(1, 12), seeds)
@settings(max_examples=60, deadline=None)
def test_a_symmetric_problem_is_bounded_least_squares(n, seed):
    random = np.random.default_rng(seed)
    A, M = definite(n, random)
    b = random.normal(size=n + 3)
    lower, upper = bounds(n, random)
    # The peer wants lower < upper: equal bounds are put into b.
    fixed = lower == upper
    held = np.where(fixed, lower, 0.0)
    peer = held.copy()
    if not fixed.all():
        free = ~fixed
        peer[free] = lsq_linear(
            A[:, free], b - A @ held, (lower[free], upper[free]), method="bvls", tol=1e-14
        ).x
    for method in ("auto", "block-pivoting", "lemke"):
        found = solve(MixedLCP(M, -A.T @ b, lower, upper), method=method)
        np.testing.assert_allclose(found.z, peer, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(peer).max()))


@given(st.integers(1, 10), seeds)
@settings(max_examples=40, deadline=None)
def test_every_method_finds_the_solution_of_a_positive_definite_problem(n, seed):
    random = np.random.default_rng(seed)
    _, M = definite(n, random)
    problem = MixedLCP(M + 0.5 * np.eye(n), random.normal(size=n), *bounds(n, random))
    expected = solve(problem).z
    for method in METHODS:
        found = solve(problem, method=method)
        assert scaled_residual(problem, found.z) <= 1e-9
        assert found.residual == natural_residual(problem, found.z)
        assert (found.z >= problem.lower).all()
        assert (found.z <= problem.upper).all()
        np.testing.assert_allclose(found.z, expected, rtol=1e-6, atol=1e-7)


@given(st.integers(1, 8), seeds)
@settings(max_examples=40, deadline=None)
def test_saddle_points_with_free_unknowns_are_solved(n, seed):
    """Quadratic programmes with equations, M = [[H, -A'], [A, 0]]: the block of the free unknowns has a zero part."""
    random = np.random.default_rng(seed)
    k = random.integers(1, n + 1)
    _, H = definite(n, random)
    A = random.normal(size=(k, n))
    M = np.block([[H, -A.T], [A, np.zeros((k, k))]])
    inside = random.uniform(0.1, 1.0, n)  # a feasible point
    q = np.append(random.normal(size=n), -A @ inside)
    lower, upper = np.append(np.zeros(n), np.full(k, -np.inf)), np.append(np.full(n, 2.0), np.full(k, np.inf))
    problem = MixedLCP(M, q, lower, upper)
    found = solve(problem)
    assert scaled_residual(problem, found.z) <= 1e-9
    assert np.abs(A @ found.z[:n] - A @ inside).max() <= 1e-8 * (1.0 + np.abs(A @ inside).max())


@given(st.integers(1, 4), seeds)
@settings(max_examples=80, deadline=None)
def test_small_whole_problems_are_solved_or_proved_to_have_no_solution_as_a_search_says(n, seed):
    """All choices of a side for every unknown, each a linear system where it is regular."""
    random = np.random.default_rng(seed)
    M, q = random.integers(-3, 4, (n, n)).astype(float), random.integers(-3, 4, n).astype(float)
    kind = random.integers(0, 4, n)
    lower = np.where(kind < 2, -np.inf, -1.0)
    upper = np.where((kind == 0) | (kind == 2), np.inf, 2.0)
    problem = MixedLCP(M, q, lower, upper)
    exists = any(_solves(problem, sides) for sides in itertools.product((-1, 0, 1), repeat=n))
    try:
        found = solve(problem)
    except InfeasibleError:
        assert not exists
    else:
        assert scaled_residual(problem, found.z) <= 1e-9


def _solves(problem, sides):
    s = np.array(sides)
    held = np.where(s < 0, problem.lower, np.where(s > 0, problem.upper, 0.0))
    if np.isinf(held).any():
        return False
    basic = s == 0
    z = held.copy()
    block = problem.M[np.ix_(basic, basic)]
    if basic.any():
        if abs(np.linalg.det(block)) < 1e-9:
            return False
        z[basic] = np.linalg.solve(block, -(problem.q + problem.M @ held)[basic])
    return natural_residual(problem, z) <= 1e-9


def test_a_bound_above_or_none_below_is_the_same_problem_seen_from_the_other_side():
    problem = MixedLCP([[2.0, -1.0], [-1.0, 2.0]], [1.0, -6.0], [-np.inf, 1.0], [0.5, np.inf])
    reduced = one_sided(problem)
    assert reduced is not None
    x = solve(reduced.lcp).z
    np.testing.assert_allclose(reduced.back(x), solve(problem).z, atol=1e-14)
    assert one_sided(MixedLCP([[1.0]], [1.0], 0.0, 1.0)) is None
    assert one_sided(MixedLCP([[1.0]], [1.0], -np.inf, np.inf)) is None


@pytest.mark.parametrize(
    "storage", [np.array, csr_array, lambda M: Tridiagonal([M[1, 0]], np.diag(M), [M[0, 1]])]
)
def test_storages_agree(storage):
    M = np.array([[2.0, -1.0], [-1.0, 2.0]])
    for lower, upper in (
        ([-np.inf, 0.0], [1.0, np.inf]),
        ([-1.0, -np.inf], [1.0, np.inf]),
        ([0.0, 0.0], [1.0, 1.0]),
    ):
        dense, stored = (MixedLCP(N, [-3.0, 1.0], lower, upper) for N in (M, storage(M)))
        np.testing.assert_allclose(solve(stored).z, solve(dense).z, atol=1e-14)


def test_the_reductions_have_the_solutions_of_the_problem():
    problem = MixedLCP(
        [[3.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, -1.0, 2.0]],
        [-9.0, 1.0, 2.0],
        [0.0, -np.inf, -1.0],
        [1.0, np.inf, 4.0],
    )
    expected = solve(problem, method="block-pivoting").z
    for reduction in (eliminated(problem), split(problem)):
        np.testing.assert_allclose(reduction.back(solve(reduction.lcp).z), expected, atol=1e-12)
    assert split(problem).is_exact


def test_proofs_are_claimed_only_where_no_number_was_rounded():
    # w = -z - 1 >= 0 for z >= lower has no solution; with 0.1 the moved problem is rounded.
    with pytest.raises(InfeasibleError):
        solve(MixedLCP([[-1.0]], [-1.0], 0.0, np.inf))
    with pytest.raises(InfeasibleError):
        solve(MixedLCP([[-1.0]], [-1.0], 0.5, np.inf))
    with pytest.raises(RayTerminationError, match="proves nothing"):
        solve(MixedLCP([[-0.1]], [-1.0], 0.1, np.inf))
    with pytest.raises(InfeasibleError):
        solve(MixedLCP([[0.0]], [1.0], -np.inf, np.inf))  # the equation 0 z + 1 = 0


def test_a_failure_carries_the_best_point_and_says_what_was_tried():
    n = 62
    M = np.zeros((n, n))
    M[0, 1] = 1.0
    q = np.ones(n)
    q[0] = -1.0
    with pytest.raises(NumericalError, match=r"tried without success.*best point") as caught:
        solve(LCP(M, q))
    best = caught.value.best
    assert best.residual == natural_residual(LCP(M, q), best.z) <= 1.0


def test_the_reason_names_why_a_method_was_taken():
    assert "bounds" in solve(MixedLCP([[1.0]], [-3.0], 0.0, 1.0)).reason
    assert solve(LCP([[1.0]], [-3.0]), method="lemke").reason == ""
    assert solve(LCP([[1.0]], [-3.0])).reason


def test_a_callback_ends_the_work_and_a_start_is_used():
    random = np.random.default_rng(3)
    _, M = definite(30, random)
    problem = MixedLCP(M, random.normal(size=30), -0.01, 0.01)
    seen = []
    found = solve(problem, callback=lambda iteration, residual: seen.append((iteration, residual)))
    assert len(seen) == found.iterations - 1
    with pytest.raises(NumericalError, match="callback") as caught:
        solve(problem, method="block-pivoting", callback=lambda iteration, residual: True)
    assert caught.value.best is not None
    assert solve(problem, start=found.z).iterations == 1
    with pytest.raises(InvalidInputError, match="callback"):
        solve(problem, callback=3)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (([[1.0]], [1.0], 1.0, 0.0), "lower[0]"),
        (([[1.0]], [1.0], np.inf, np.inf), "lower"),
        (([[1.0]], [1.0], 0.0, -np.inf), "upper"),
        (([[1.0]], [1.0], np.nan, 1.0), "lower"),
        (([[1.0]], [1.0], [0.0, 1.0], 1.0), "lower"),
        (([[1.0]], [1.0], 0.0, "a"), "upper"),
        (([[1.0]], [1.0, 2.0], 0.0, 1.0), "q"),
        (([[1.0, 2.0]], [1.0], 0.0, 1.0), "M"),
    ],
)
def test_bad_input_is_named(arguments, field):
    with pytest.raises(InvalidInputError) as caught:
        MixedLCP(*arguments)
    assert caught.value.field == field


def test_a_mixed_problem_is_no_lcp_where_one_is_needed():
    with pytest.raises(InvalidInputError, match="LCP"):
        solve([[1.0]])  # type: ignore[arg-type]


def test_a_problem_without_unknowns_has_the_empty_solution():
    assert solve(MixedLCP(np.zeros((0, 0)), [], [], [])).z.shape == (0,)
