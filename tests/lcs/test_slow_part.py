import numpy as np
import pytest

from pricing_core.lcs.mode_dynamics import ModeDynamics
from pricing_core.lcs.mode_maps import ExactMaps, ModeMaps
from pricing_core.lcs.slow_part import slow_part
from pricing_core.linalg.rational import exact_product, exact_solution, rational_array, rounded


def stiff(rng):
    """Return dynamics with one rate of 1e12 to 1e14, one of 1e8 to 1e11, and a slow motion of three dimensions.

    All of them are mixed by an integer change of coordinates. Returned too are the slow motion's own rates and outputs.
    """
    n = 5
    groups = np.zeros((n, n), dtype=object)
    groups[0, 0] = -int(rng.integers(1, 100)) * 10 ** int(rng.integers(12, 14))
    groups[1, 1] = -int(rng.integers(1, 10)) * 10 ** int(rng.integers(8, 11))
    slow = rng.integers(-3, 4, (3, 3))
    slow[np.diag_indices(3)] += 7
    groups[2:, 2:] = slow
    T = np.eye(n, dtype=int)
    for _ in range(12):
        i, j = rng.choice(n, 2, replace=False)
        T[i] += int(rng.choice([-1, 1])) * T[j]
    there, groups = rational_array(T), rational_array(groups)
    back = exact_solution(there, rational_array(np.eye(n, dtype=int)))
    rate = exact_product(exact_product(there, groups), back)
    outputs = rational_array(rng.integers(-3, 4, (2, n)))
    eye = rational_array(np.eye(n, dtype=int))
    exact = ExactMaps(rate, eye, outputs)
    parts = np.eye(n), np.eye(n), rounded(rate), rounded(outputs), np.zeros((0, 2, n))
    dynamics = ModeDynamics((), *parts, 2.0 / float(np.abs(parts[2]).max()), ModeMaps(*parts, exact))
    return dynamics, slow.astype(float), rounded(exact_product(outputs, there[:, 2:])), rounded(back[2:])


@pytest.mark.parametrize("seed", range(40))
def test_what_is_left_of_two_fast_groups_knows_nothing_of_their_rounding(seed):
    dynamics, rate, outputs, take = stiff(np.random.default_rng(seed))
    first = slow_part(dynamics)
    second = slow_part(first.dynamics)
    found = second.dynamics
    assert found.rate.shape == (3, 3)
    own = take @ found.basis  # the slow motion's own coordinates
    assert np.linalg.solve(own, rate @ own) == pytest.approx(found.rate, rel=1e-11, abs=1e-11)
    assert found.outputs == pytest.approx(outputs @ own, rel=1e-11, abs=1e-11)
    z = np.random.default_rng(seed).normal(size=5)
    assert own @ (second.take @ (first.take @ z)) == pytest.approx(take @ z, abs=1e-10)
