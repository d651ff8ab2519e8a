"""Signs of determinants, and Schur complements, against rational arithmetic."""

import numpy as np
import pytest
from flint import fmpq, fmpq_mat

from pricing_core.arrays import Matrix
from pricing_core.linalg.determinant import determinant_sign, schur_complement


def exact(M: Matrix) -> fmpq_mat:
    return fmpq_mat([[fmpq(*value.as_integer_ratio()) for value in row] for row in M.tolist()])


def test_signs_of_nearly_singular_matrices_of_any_scale_are_exact() -> None:
    counts = {-1: 0, 0: 0, 1: 0}
    for seed in range(400):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 7))
        M = random.integers(-3, 4, (n, n)).astype(float)
        if n > 1:
            M[:, -1] = M[:, :-1] @ random.integers(-2, 3, n - 1)
        M = M + 10.0 ** random.uniform(-18.0, 0.0) * (random.random((n, n)) < 0.2)
        M = M * 10.0 ** random.uniform(-40.0, 40.0, (n, 1)) * 10.0 ** random.uniform(-40.0, 40.0, n)
        determinant = exact(M).det()
        sign = int(determinant > 0) - int(determinant < 0)
        assert determinant_sign(M) == sign
        counts[sign] += 1
    assert min(counts.values()) > 10


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_large_matrices_do_not_overflow(size: float) -> None:
    assert determinant_sign(size * np.eye(500)) == 1
    assert determinant_sign(size * np.eye(500)[::-1]) == 1
    assert determinant_sign(np.diag(np.append(-size, np.ones(300)))) == -1
    assert determinant_sign(np.zeros((3, 3))) == 0
    assert determinant_sign(np.zeros((0, 0))) == 1


def test_schur_complements_are_the_exact_ones_rounded() -> None:
    random = np.random.default_rng(0)
    M = random.normal(size=(6, 6))
    M[1] = M[0] * (1.0 + 1e-14 * random.normal(size=6))
    block, rest = (0, 1, 4), (2, 3, 5)
    order = [*block, *rest]
    inverse = exact(M[np.ix_(order, order)]).inv()  # its last block is the inverse of the complement
    last = fmpq_mat([[inverse[i, j] for j in range(3, 6)] for i in range(3, 6)]).inv()
    expected = [[int(last[i, j].p) / int(last[i, j].q) for j in range(3)] for i in range(3)]
    np.testing.assert_allclose(schur_complement(M, block, rest), expected, rtol=1e-15)
    assert schur_complement(M, order, ()).shape == (0, 0)
