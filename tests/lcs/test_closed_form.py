import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from pricing_core.lcs.closed_form import closed_form

SPIN = np.array([[0.0, 1.0], [-1.0, 0.0]])
FALL = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


def mixed(rng: np.random.Generator):
    """Oscillations, decays and a fall, mixed by a random change of coordinates."""
    parts = [
        rng.uniform(0.5, 3.0) * SPIN - rng.uniform(0.0, 0.5) * np.eye(2),
        FALL,
        [[-rng.uniform(0.1, 2.0)]],
    ]
    R = block_diag(*parts)
    T = np.linalg.qr(rng.normal(size=R.shape))[0]
    return T @ R @ T.T


@pytest.mark.parametrize("seed", range(10))
def test_states_are_those_of_the_exponential(seed):
    rng = np.random.default_rng(seed)
    R, c = mixed(rng), rng.normal(size=6)
    times = np.array([0.0, 0.3, 4.0, 20.0])
    exact = np.array([expm(R * t) @ c for t in times])
    assert closed_form(R).states(c, times) == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())


@pytest.mark.parametrize("seed", range(10))
def test_outputs_stay_inside_their_bounds(seed):
    rng = np.random.default_rng(seed)
    R, c, outputs = mixed(rng), rng.normal(size=6), rng.normal(size=(3, 6))
    form = closed_form(R)
    low, high = form.bounds(outputs, c, 7.0)
    values = form.states(c, np.linspace(0.0, 7.0, 400)) @ outputs.T
    assert (values >= low - 1e-9).all()
    assert (values <= high + 1e-9).all()


def test_what_grows_has_no_bounds():
    low, high = closed_form(np.array([[1.0]])).bounds(np.eye(1), np.array([1.0]), 10.0)
    assert (low, high) == (-np.inf, np.inf)


@pytest.mark.parametrize(
    "rate",
    [
        block_diag(SPIN + 0.0, SPIN)
        + np.eye(4, k=2),  # two oscillations of one frequency that feed each other
        block_diag([[-1.0]], 1e-13 * SPIN, 1e-13 * SPIN),  # slow, not zero
    ],
    ids=["resonance", "slow"],
)
def test_what_is_not_known_well_enough_has_no_closed_form(rate):
    assert closed_form(rate) is None


def test_no_states_and_no_rates_have_one():
    assert closed_form(np.zeros((0, 0))).states(np.zeros(0), np.array([1.0])).shape == (1, 0)
    assert closed_form(np.zeros((2, 2))).states(np.ones(2), np.array([1e9])) == pytest.approx(np.ones((1, 2)))
