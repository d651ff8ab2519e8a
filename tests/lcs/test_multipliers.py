import numpy as np
import pytest

from pricing_core.lcp import LCP, least_norm_solution
from pricing_core.lcs import LCS, simulate
from pricing_core.lcs.multipliers import least_norm_multipliers


@pytest.mark.parametrize("seed", range(40))
def test_a_multiplier_is_left_alone_only_where_it_is_the_least_one(seed):
    """Monotone problems with repeated columns: the quadratic programme finds nothing less anywhere."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(2, 6))
    C = rng.integers(-1, 2, size=(k, n)).astype(float)
    K = np.triu(rng.integers(-1, 2, size=(k, k)), 1).astype(float) * (rng.random() < 0.5)
    system = LCS(
        -np.eye(n), C.T, C, K - K.T, f=rng.normal(size=n), g=rng.integers(0, 2, size=k).astype(float)
    )
    run = simulate(system, rng.integers(0, 3, size=n).astype(float), (0.0, 2.0))
    u, y = least_norm_multipliers(system, run.u, run.y)
    for held, slack in zip(u, y, strict=True):
        least = least_norm_solution(LCP(system.D, slack - system.D @ held), held, kept=system.B)
        assert np.linalg.norm(held) <= np.linalg.norm(least) + 1e-7
        assert (held >= 0.0).all()


def test_multipliers_along_a_refined_run_are_least_in_the_units_given():
    """x' = -x - u1 - 1000 u2 on y = 1 - x held by w = 2: of u1 + 1000 u2 = 1 the least, where x = 1 is held."""
    system = LCS([[-1.0]], [[-1.0, -1000.0]], [[-1.0], [-1000.0]], f=[2.0], g=[1.0, 1000.0])
    run = simulate(system, [0.0], (0.0, 2.0)).refined(50)
    held = run.u[run.t > 1.0]
    assert held == pytest.approx(np.tile([1.0, 1000.0], (len(held), 1)) / (1.0 + 1000.0**2), rel=1e-6)
