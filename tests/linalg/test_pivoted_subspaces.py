"""Kernels, images and solutions by pivoted factorisations, against the definition and singular values."""

import numpy as np
import pytest

from pricing_core.linalg.pivoted_subspaces import pivoted_image, pivoted_kernel, pivoted_solution
from pricing_core.linalg.subspaces import image, kernel

TOLERANCE = 1e-10


@pytest.mark.parametrize("seed", range(40))
def test_subspaces_of_matrices_of_any_rank_are_those_of_singular_values(seed):
    rng = np.random.default_rng(seed)
    m, n = (int(size) for size in rng.integers(0, 40, 2))
    rank = int(rng.integers(0, min(m, n) + 1))
    M = (
        rng.normal(size=(m, rank))
        @ np.diag(10.0 ** rng.uniform(-3.0, 3.0, rank))
        @ rng.normal(size=(rank, n))
    )
    for found, known in (
        (pivoted_kernel(M, TOLERANCE), kernel(M, TOLERANCE)),
        (pivoted_image(M, TOLERANCE), image(M, TOLERANCE)),
    ):
        assert found.shape == known.shape
        assert found @ found.T == pytest.approx(known @ known.T, abs=1e-8)
    R = M @ rng.normal(size=(n, 3))
    assert M @ pivoted_solution(M, R, TOLERANCE) == pytest.approx(R, abs=1e-9 * np.abs(R).max(initial=1.0))
