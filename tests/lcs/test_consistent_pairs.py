"""What is reported satisfies y = Cx + Du + g, 0 <= y _|_ u >= 0 at the states reported."""

import numpy as np
import pytest

from pricing_core.errors import NotFoundError
from pricing_core.lcp import LCP, solve
from pricing_core.lcs import LCS, simulate, sine
from pricing_core.lcs.consistent_pairs import consistent_pairs

SHARE = 1e-9  # of the largest terms of a row


def mixed_feedthrough(rng):
    """Return a passive system whose feedthrough has a diagonal from 1e-14 to 1e14, and a start."""
    n, k = int(rng.integers(1, 6)), int(rng.integers(2, 6))
    J, C, K = rng.normal(size=(n, n)), rng.normal(size=(k, n)), rng.normal(size=(k, k))
    d = 10.0 ** rng.uniform(-14.0, 14.0, k)
    D = np.diag(d) + np.sqrt(d)[:, None] * (K - K.T) * np.sqrt(d)
    g = sine(rng.normal(size=k), float(rng.uniform(0.1, 1.0)), phase=float(rng.uniform(0.0, 6.0)))
    return LCS(J - J.T - rng.uniform(0.0, 0.5) * np.eye(n), C.T, C, D, g=g), rng.normal(size=n)


@pytest.mark.parametrize("seed", [*range(20), 52, 145, 189, 246, 281])
def test_feedthrough_of_mixed_scales_satisfies_its_equations_at_every_point(seed):
    system, x0 = mixed_feedthrough(np.random.default_rng(seed))
    run = simulate(system, x0, (0.0, 3.0))
    for at in (run, run.refined(100)):
        free = at.x @ system.C.T + np.array([system.g.after(t) for t in at.t])
        terms = np.abs(at.x) @ np.abs(system.C).T + np.abs(at.u) @ np.abs(system.D).T + 1.0
        assert (np.abs(free + at.u @ system.D.T - at.y) <= 2.0 * SHARE * terms.max(axis=0)).all()
        assert (at.u >= 0.0).all()
        assert (at.y >= 0.0).all()
        assert not (at.u * at.y).any()


@pytest.mark.parametrize("seed", range(30))
def test_inputs_off_by_rounding_of_the_state_are_mended_and_others_left_alone(seed):
    """Inputs with what 1e-12 in the state makes of them: beside D from 1e-8 to 1e8 that is 1e-4 and less."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, 7))
    d, K = 10.0 ** rng.uniform(-4.0, 4.0, k), rng.normal(size=(k, k))
    D = d[:, None] * (np.eye(k) + K - K.T) * d
    system, z = LCS(-np.eye(k), np.eye(k), np.eye(k), D), rng.normal(size=(20, k))
    exact = [solve(LCP(D, row)) for row in z]
    u, y = np.array([found.z for found in exact]), np.array([found.w for found in exact])
    y[u > 0.0] = 0.0
    kept = consistent_pairs(system, z, u, y, np.arange(20.0), 1.0)
    assert np.array_equal(kept[0], u)
    assert np.array_equal(kept[1], y)
    off = u * (1.0 + 1e-4 * rng.normal(size=u.shape)) - (u == 0.0) * 1e-4 * (rng.random(u.shape) < 0.2) / d**2
    found, slack = consistent_pairs(system, z, off, y, np.arange(20.0), 1.0)
    assert (found >= 0.0).all()
    assert (slack >= 0.0).all()
    assert not (found * slack).any()
    terms = np.abs(z) + np.abs(off) @ np.abs(D).T
    assert (np.abs(z + found @ D.T - slack) <= 2.0 * SHARE * terms.max(axis=0)).all()


def test_inputs_that_no_state_determines_are_not_reported_where_they_pull():
    system = LCS([[0.0]], [[1.0]], [[1.0]])
    with pytest.raises(NotFoundError, match=r"the pairs \[0\] miss"):
        consistent_pairs(
            system, np.array([[0.0]]), np.array([[-1.0]]), np.array([[0.0]]), np.array([2.0]), 0.0
        )
