"""Equilibration of dense and sparse matrices: the largest entry of every row and column is near one."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from pricing_core.linalg.equilibration import equilibration


@pytest.mark.parametrize("seed", range(20))
def test_rows_and_columns_of_any_size_are_brought_near_one_in_both_storages(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 15))
    M = rng.uniform(0.5, 2.0, (n, n)) * np.where(
        rng.random((n, n)) < 0.4, rng.choice([-1.0, 1.0], (n, n)), 0.0
    )
    M = 10.0 ** rng.uniform(-12.0, 12.0, n)[:, None] * M * 10.0 ** rng.uniform(-12.0, 12.0, n)
    for row, column in (equilibration(M), equilibration(csr_array(M))):
        sizes = np.abs(row[:, None] * M * column)
        largest = np.concatenate([sizes.max(axis=0), sizes.max(axis=1)])
        assert largest.max() <= 10.0
        assert largest[largest > 0.0].min(initial=1.0) >= 0.1
        assert (row[~M.any(axis=1)] == 1.0).all()
        assert (column[~M.any(axis=0)] == 1.0).all()
