"""The sweeps over sparse matrices: the kernel and its twin, by hand and against each other."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from pricing_core import kernel, sparse_twin

IMPLEMENTATIONS = [
    pytest.param(sparse_twin.sparse_sweeps, id="numpy"),
    pytest.param(kernel.sparse_sweeps, id="kernel"),
]
STRING = csr_array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])


def parts(M):
    return M.indptr.astype(np.int64), M.indices.astype(np.int64), M.data


@pytest.mark.parametrize("sweeps", IMPLEMENTATIONS)
def test_sweeps_forward_and_backward_by_hand(sweeps):
    q, zero, infinite = np.array([-2.0, 0.0, -8.0]), np.zeros(3), np.full(3, np.inf)
    once, count = sweeps(*parts(STRING), q, zero, infinite, zero, 1.0, 0.0, 1, True)
    assert (once.tolist(), count) == ([1.0, 0.5, 4.25], 2)
    twice, _ = sweeps(*parts(STRING), q, zero, infinite, zero, 1.0, 0.0, 2, True)
    assert twice.tolist() == [2.3125, 2.625, 4.25]


@pytest.mark.parametrize("sweeps", IMPLEMENTATIONS)
def test_bounds_hold_and_settled_sweeps_end(sweeps):
    q, zero, two = np.array([0.0, 0.0, -4.0]), np.zeros(3), np.full(3, 2.0)
    z, count = sweeps(*parts(STRING), q, zero, two, zero, 1.0, 1e-15, 500, True)
    np.testing.assert_allclose(z, [2 / 3, 4 / 3, 2.0], atol=1e-14)
    assert count < 100
    assert sweeps(*parts(STRING), q, zero, two, z, 1.0, 1e-12, 500, False)[1] == 1


@pytest.mark.parametrize("sweeps", IMPLEMENTATIONS)
def test_a_pivot_of_zero_and_an_interrupt_end_the_work(sweeps):
    q, zero, two = np.ones(2), np.zeros(2), np.full(2, 2.0)
    with pytest.raises(ZeroDivisionError, match="pivot 1"):
        sweeps(*parts(csr_array([[1.0, 1.0], [1.0, 0.0]])), q, zero, two, zero, 1.0, 0.0, 9, False)
    _, count = sweeps(*parts(csr_array(np.eye(2))), q, zero, two, zero, 0.5, -1.0, 9, False, lambda: True)
    assert count == 10


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_equals_its_twin(seed):
    random = np.random.default_rng(seed)
    n = 30
    M = csr_array(np.where(random.random((n, n)) < 0.2, random.normal(size=(n, n)), 0.0) + 9.0 * np.eye(n))
    lower = np.where(random.random(n) < 0.5, -np.inf, -0.01)
    given = (*parts(M), random.normal(size=n), lower, np.full(n, 0.02), np.zeros(n), 0.9, 1e-9, 40, True)
    (found, count), (expected, twin_count) = kernel.sparse_sweeps(*given), sparse_twin.sparse_sweeps(*given)
    assert count == twin_count
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


def test_the_kernel_refuses_what_is_no_matrix():
    if kernel.kernel_name() != "rust":
        pytest.skip("the twin trusts its callers")
    q, zero = np.ones(2), np.zeros(2)
    for indptr, indices in (([0, 1], [0, 1]), ([0, 1, 2], [0, 7]), ([0, 1, 2], [0, -1]), ([0, 2, 1], [0, 1])):
        with pytest.raises(ValueError, match=r"indptr|indices"):
            kernel.sparse_sweeps(
                np.array(indptr), np.array(indices), np.ones(2), q, zero, q, zero, 1.0, 0.0, 9, False
            )
