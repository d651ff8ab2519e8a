import numpy as np
import pytest

from pricing_core.linalg.rational import exact_product, rational_array
from pricing_core.linalg.rational_definite import is_exactly_positive_definite, negative_vector


@pytest.mark.parametrize("seed", range(40))
def test_semidefinite_or_with_a_negative_vector(seed):
    rng = np.random.default_rng(seed)
    H = rng.integers(-2, 3, (4, int(rng.integers(1, 6))))
    M = H @ H.T - int(rng.integers(0, 2)) * np.diag(rng.integers(0, 2, 4))
    exact = rational_array(M)
    v = negative_vector(exact)
    smallest = np.linalg.eigvalsh(M)[0]
    if v is None:
        assert smallest > -1e-9
    else:
        assert v @ exact @ v < 0
    assert is_exactly_positive_definite(exact) == (smallest > 1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_nearly_singular_matrices_are_decided_exactly_at_every_scale(seed):
    """H^T H is definite by its construction; less a multiple of a rank-one part it is singular, or negative."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    H = rational_array(np.tril(rng.integers(-9, 10, (n, n)), -1) + np.eye(n, dtype=int))
    units = rational_array(2.0 ** rng.integers(-300, 300, n))
    M = H.T @ H * np.outer(units, units)
    assert is_exactly_positive_definite(M)
    last = H[-1] * units
    assert negative_vector(M - np.outer(last, last)) is None
    assert not is_exactly_positive_definite(M - np.outer(last, last))
    excess = rational_array(np.array([1.0 + 2.0**-45]))[0]
    assert negative_vector(M - excess * np.outer(last, last)) is not None


def test_a_large_definite_matrix_is_decided_by_its_rounded_factorisation():
    H = np.random.default_rng(0).standard_normal((80, 80))
    exact = rational_array(H)
    assert is_exactly_positive_definite(exact_product(exact, exact.T))
