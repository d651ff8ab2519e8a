"""The compiled kernel against its NumPy twin, and what each of them refuses."""

import threading
import time
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core import kernel, kernel_name, kernel_twin
from pricing_core.arrays import BoolVector, Vector
from tests.problems.needs_kernel import needs_kernel

sizes = st.integers(1, 60)
seeds = st.integers(0, 2**32 - 1)
Problem = tuple[Vector, Vector, Vector, Vector]
ROUNDING = 1e-14


@pytest.fixture
def compiled() -> ModuleType:
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


@pytest.fixture(params=["rust", "numpy"])
def implementation(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "numpy":
        return kernel_twin
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


def m_matrix_problem(size: int, seed: int) -> Problem:
    """Return bands of an unsymmetric, strictly diagonally dominant M-matrix, and q of either sign."""
    random = np.random.default_rng(seed)
    lower, upper = -random.uniform(0.0, 1.0, (2, size - 1))
    diagonal = random.uniform(0.05, 1.0, size)
    diagonal[1:] -= lower
    diagonal[:-1] -= upper
    return lower, diagonal, upper, random.normal(size=size)


def random_set(size: int, seed: int) -> BoolVector:
    return np.random.default_rng(seed).random(size) < 0.5


def slack(problem: Problem, z: Vector) -> Vector:
    lower, diagonal, upper, q = problem
    w = q + diagonal * z
    w[1:] += lower * z[:-1]
    w[:-1] += upper * z[1:]
    return w


def test_the_kernel_in_use_is_the_one_that_is_named() -> None:
    expected = {"rust": "_kernels", "numpy": "kernel_twin"}[kernel_name()]
    for function in (kernel.brennan_schwartz, kernel.policy_iteration, kernel.projected_sor):
        assert function.__module__.split(".")[-1] == expected


@needs_kernel
@given(sizes, seeds, st.booleans())
def test_brennan_schwartz_equals_its_twin(size: int, seed: int, contact_first: bool) -> None:
    problem = m_matrix_problem(size, seed)
    found = kernel.brennan_schwartz(*problem, contact_first)
    expected = kernel_twin.brennan_schwartz(*problem, contact_first)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * max(1.0, expected.max()))


@needs_kernel
@given(sizes, seeds, seeds)
def test_policy_iteration_equals_its_twin_from_any_start(size: int, seed: int, start: int) -> None:
    arguments = (*m_matrix_problem(size, seed), random_set(size, start), ROUNDING, size + 2)
    found, systems = kernel.policy_iteration(*arguments)
    expected, twin_systems = kernel_twin.policy_iteration(*arguments)
    assert systems == twin_systems <= size + 2
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * max(1.0, expected.max()))


@needs_kernel
@given(sizes, seeds, st.floats(0.5, 1.6))
def test_projected_sor_equals_its_twin_after_the_same_sweeps(size: int, seed: int, relaxation: float) -> None:
    problem = m_matrix_problem(size, seed)
    start = np.ones(size)
    found, sweeps = kernel.projected_sor(*problem, start, relaxation, -1.0, 25)
    expected, twin_sweeps = kernel_twin.projected_sor(*problem, start, relaxation, -1.0, 25)
    assert sweeps == twin_sweeps == 26
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * max(1.0, expected.max()))


@needs_kernel
@pytest.mark.parametrize("seed", range(5))
def test_projected_sor_stops_after_as_many_sweeps_as_its_twin(seed: int) -> None:
    problem = m_matrix_problem(40, seed)
    arguments = (*problem, np.zeros(40), 1.2, 1e-9, 10_000)
    found, sweeps = kernel.projected_sor(*arguments)
    expected, twin_sweeps = kernel_twin.projected_sor(*arguments)
    assert sweeps == twin_sweeps <= 10_000
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("contact_first", [True, False])
@pytest.mark.parametrize("size", [1, 2, 3, 50, 1000])
def test_a_contact_run_at_one_end_is_solved_exactly(
    implementation: ModuleType, size: int, contact_first: bool
) -> None:
    # z and w are chosen first, complementary with contact on the first half; then q = w - M z.
    lower, diagonal, upper, _ = m_matrix_problem(size, seed=size)
    contact = np.arange(size) < size // 2
    if not contact_first:
        contact = contact[::-1]
    z, w = np.where(contact, 0.0, 1.5), np.where(contact, 2.0, 0.0)
    q = w - slack((lower, diagonal, upper, np.zeros(size)), z)
    found = implementation.brennan_schwartz(lower, diagonal, upper, q, contact_first)
    np.testing.assert_allclose(found, z, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("start", ["nothing", "everything", "random", "solution"])
@pytest.mark.parametrize("size", [1, 2, 3, 50, 400])
def test_any_contact_set_is_found_by_policy_iteration(
    implementation: ModuleType, size: int, start: str
) -> None:
    lower, diagonal, upper, _ = m_matrix_problem(size, seed=size)
    free = random_set(size, seed=2 * size)
    z, w = np.where(free, 1.5, 0.0), np.where(free, 0.0, 2.0)
    q = w - slack((lower, diagonal, upper, np.zeros(size)), z)
    starts = {
        "nothing": np.zeros(size, dtype=np.bool_),
        "everything": np.ones(size, dtype=np.bool_),
        "random": random_set(size, seed=1),
        "solution": free,
    }
    found, systems = implementation.policy_iteration(
        lower, diagonal, upper, q, starts[start], ROUNDING, size + 2
    )
    np.testing.assert_allclose(found, z, rtol=1e-12, atol=1e-12)
    assert systems <= (1 if start == "solution" else size + 2)


def test_policy_iteration_says_when_it_did_not_settle(implementation: ModuleType) -> None:
    # Both rows leave the basic set, then both enter: no M-matrix.
    bands = np.array([-2.0]), np.array([1.0, 1.0]), np.array([-2.0])
    both = np.array([True, True])
    for limit in (0, 1, 2, 5):
        z, systems = implementation.policy_iteration(*bands, np.array([-1.0, -1.0]), both, ROUNDING, limit)
        assert systems == limit + 1
        np.testing.assert_array_equal(z, [0.0, 0.0])


def test_all_methods_agree_on_an_obstacle_problem(implementation: ModuleType) -> None:
    size = 60
    lower = upper = np.full(size - 1, -1.0)
    problem = (lower, np.full(size, 2.1), upper, np.linspace(1.0, -1.0, size))
    direct = implementation.brennan_schwartz(*problem, True)
    swept, sweeps = implementation.projected_sor(*problem, np.zeros(size), 1.5, 1e-13, 2000)
    assert sweeps <= 2000
    assert 0 < np.count_nonzero(direct == 0.0) < size
    assert np.abs(np.minimum(direct, slack(problem, direct))).max() <= 1e-12
    np.testing.assert_allclose(swept, direct, atol=1e-11)
    iterated, systems = implementation.policy_iteration(*problem, random_set(size, 7), ROUNDING, 62)
    assert systems <= 62
    np.testing.assert_allclose(iterated, direct, atol=1e-13)


def test_no_argument_is_modified(implementation: ModuleType) -> None:
    problem, start, basic_set = m_matrix_problem(20, seed=1), np.full(20, 3.0), random_set(20, seed=1)
    before = [part.copy() for part in (*problem, start, basic_set)]
    implementation.brennan_schwartz(*problem, True)
    implementation.projected_sor(*problem, start, 1.1, 1e-9, 50)
    implementation.policy_iteration(*problem, basic_set, ROUNDING, 50)
    for part, copy in zip((*problem, start, basic_set), before, strict=True):
        np.testing.assert_array_equal(part, copy)


@pytest.mark.parametrize("contact_first", [True, False])
def test_views_with_strides_give_the_values_of_their_copies(
    implementation: ModuleType, contact_first: bool
) -> None:
    problem = m_matrix_problem(30, seed=2)
    reversed_views = tuple(part[::-1].copy()[::-1] for part in problem)
    spread_views = tuple(np.repeat(part, 3)[::3] for part in problem)
    expected = implementation.brennan_schwartz(*problem, contact_first)
    for views in (reversed_views, spread_views):
        found = implementation.brennan_schwartz(*views, contact_first)
        np.testing.assert_array_equal(found, expected)
        swept, _ = implementation.projected_sor(*views, views[3], 1.0, 1e-9, 3)
        copied, _ = implementation.projected_sor(*problem, problem[3], 1.0, 1e-9, 3)
        np.testing.assert_array_equal(swept, copied)
        iterated, _ = implementation.policy_iteration(*views, views[3] < 0.0, ROUNDING, 32)
        settled, _ = implementation.policy_iteration(*problem, problem[3] < 0.0, ROUNDING, 32)
        np.testing.assert_array_equal(iterated, settled)


@pytest.mark.parametrize(("row", "contact_first"), [(0, True), (1, True), (0, False), (1, False)])
def test_a_zero_pivot_raises(implementation: ModuleType, row: int, contact_first: bool) -> None:
    diagonal = np.array([2.0, 2.0])
    diagonal[row] = 0.0
    apart = np.zeros(1)
    with pytest.raises(ZeroDivisionError):
        implementation.brennan_schwartz(apart, diagonal, apart, np.ones(2), contact_first)
    with pytest.raises(ZeroDivisionError):
        implementation.projected_sor(apart, diagonal, apart, np.ones(2), np.ones(2), 1.0, 1e-9, 5)
    with pytest.raises(ZeroDivisionError):
        implementation.policy_iteration(apart, diagonal, apart, np.ones(2), diagonal < 3.0, ROUNDING, 5)


@pytest.mark.parametrize("contact_first", [True, False])
def test_nan_is_not_hidden_by_the_projection(implementation: ModuleType, contact_first: bool) -> None:
    lower, diagonal, upper, q = m_matrix_problem(5, seed=3)
    q[2] = np.nan
    assert np.isnan(implementation.brennan_schwartz(lower, diagonal, upper, q, contact_first)[2])
    z, sweeps = implementation.projected_sor(lower, diagonal, upper, q, np.zeros(5), 1.0, 1e-9, 5)
    assert np.isnan(z[2])
    assert sweeps == 6
    for basic_set in (q < 2.0, np.zeros(5, dtype=np.bool_)):
        z, _ = implementation.policy_iteration(lower, diagonal, upper, q, basic_set, ROUNDING, 7)
        assert np.isnan(z[2])


@pytest.mark.parametrize("wrong", range(5))
def test_the_compiled_kernel_refuses_vectors_that_do_not_fit(compiled: ModuleType, wrong: int) -> None:
    parts = [*m_matrix_problem(4, seed=4), np.zeros(4)]
    parts[wrong] = np.ones(7)
    with pytest.raises(ValueError, match=r"has length \d+: must be \d+"):
        compiled.projected_sor(*parts, 1.0, 1e-9, 5)
    if wrong < 4:
        with pytest.raises(ValueError, match=r"has length \d+: must be \d+"):
            compiled.brennan_schwartz(*parts[:4], True)
    with pytest.raises(ValueError, match=r"has length \d+: must be \d+"):
        compiled.policy_iteration(*parts[:4], parts[4] < 1.0, ROUNDING, 5)


def test_the_compiled_kernel_refuses_an_empty_matrix_and_other_types(compiled: ModuleType) -> None:
    empty = np.zeros(0)
    with pytest.raises(ValueError, match="diagonal has length 0"):
        compiled.brennan_schwartz(empty, empty, empty, empty, True)
    problem = m_matrix_problem(4, seed=5)
    with pytest.raises(TypeError):
        compiled.brennan_schwartz(*problem[:3], problem[3].astype(np.float32), True)
    with pytest.raises(TypeError):
        compiled.brennan_schwartz(*problem[:3], problem[3].reshape(2, 2), True)
    with pytest.raises(TypeError):
        compiled.policy_iteration(*problem, problem[3], ROUNDING, 5)


def test_other_threads_run_while_the_compiled_kernel_works(compiled: ModuleType) -> None:
    problem, start = m_matrix_problem(2000, seed=6), np.zeros(2000)

    def naps_beside(sweeps: int) -> int:
        """Return how often this thread runs while another one is in the kernel."""
        work = threading.Thread(target=compiled.projected_sor, args=(*problem, start, 1.0, -1.0, sweeps))
        work.start()
        naps = 0
        while work.is_alive():
            time.sleep(0.001)
            naps += 1
        return naps

    # With the interpreter lock held throughout, the first nap would end after the work, however long that is.
    assert any(naps_beside(5_000 << k) > 5 for k in range(10))


@needs_kernel
@given(st.integers(1, 4), st.integers(2, 30), st.integers(0, 5), st.integers(0, 5), seeds)
def test_a_march_of_strikes_equals_its_twin(
    steps: int, nodes: int, american: int, european: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    off = -rng.uniform(0.0, 1.0, (steps, 2, nodes))
    middle = 1.0 + rng.uniform(0.0, 1.0, (steps, nodes)) - off.sum(axis=1)
    matrices = np.stack([off[:, 0], middle, off[:, 1]], axis=1)
    values = rng.uniform(0.0, 1.0, (nodes, american + european))
    obstacle = np.sort(rng.uniform(0.0, 1.0, (nodes, american)), axis=0)[::-1]
    factors = rng.uniform(0.5, 1.5, (steps, 2)) * np.array([1.0, 0.3])
    found = kernel.march_strikes(factors, matrices, values, obstacle)
    expected = kernel_twin.march_strikes(factors, matrices, values, obstacle)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
