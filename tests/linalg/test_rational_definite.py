import numpy as np
import pytest

from pricing_core.linalg.rational import rational_array
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
