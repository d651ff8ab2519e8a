import numpy as np
import pytest

from pricing_core.errors import InfeasibleError, NotFoundError
from pricing_core.lcs import LCS, TimeStepping, simulate, sine
from pricing_core.lcs.infeasible_start import nothing_goes_on


def in_other_coordinates(rng, A, B, C, D, x0):
    """Return the system and the state after an integer change of coordinates, in units that differ by 2**40."""
    n, k = B.shape
    T = np.eye(n, dtype=int)
    for _ in range(n - 1):
        i, j = rng.choice(n, 2, replace=False)
        T[i] += int(rng.integers(-2, 3)) * T[j]
    inverse = np.rint(np.linalg.inv(T)).astype(int)
    x, u = (2.0 ** rng.integers(-20, 21, size) for size in (n, k))
    system = LCS(
        (T @ A @ inverse) * x / x[:, None],
        (T @ B) * u / x[:, None],
        (C @ inverse) * x * u[:, None],
        D * u * u[:, None],
    )
    return system, (T @ x0) / x


def passive(rng):
    """x' = Ax + Bu, y = B^T x + Du with any A, B of any rank, D + D^T >= 0: S(x0) holds a set for every x0."""
    n, k = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    B, D, K = rng.integers(-2, 3, (n, k)), rng.integers(-1, 2, (k, k)), rng.integers(-2, 3, (k, k))
    D = rng.integers(0, 2) * (D @ D.T + K - K.T)
    return rng.integers(-3, 4, (n, n)), B, B.T, D


@pytest.mark.parametrize("seed", range(60))
def test_no_passive_system_is_refused_at_its_start(seed):
    rng = np.random.default_rng(seed)
    A, B, C, D = passive(rng)
    x0 = rng.integers(-3, 4, A.shape[0])
    assert not nothing_goes_on(*in_other_coordinates(rng, A, B, C, D, x0), 0.0)


@pytest.mark.parametrize("method", ["event-driven", "time-stepping"])
@pytest.mark.parametrize("seed", range(20))
def test_an_output_that_no_input_moves_decides(seed, method):
    """Beside a passive system x_n' = a x_n, y_k = x_n, hidden by a change of coordinates: x_n >= 0 is wanted."""
    rng = np.random.default_rng(seed)
    A, B, C, D = (np.pad(part, ((0, 1), (0, 1))) for part in passive(rng))
    A[-1, -1], B[-1, -1], C[-1, -1] = rng.integers(-2, 3), 0, 1
    for height in (-1, 0, 1):
        x0 = np.append(rng.integers(-3, 4, A.shape[0] - 1), height)
        system, start = in_other_coordinates(rng, A, B, C, D, x0)
        assert nothing_goes_on(system, start, 0.0) == (height < 0)
        if height < 0:
            with pytest.raises(InfeasibleError, match="proved"):
                simulate(system, start, (0.0, 1e-3), method=method)


def test_a_start_far_below_the_rounding_of_its_neighbours_is_not_refused():
    """y = x1 + 1e-20 x2 from (0, 1): y > 0, and from (0, -1): no input helps."""
    system = LCS(np.zeros((2, 2)), np.zeros((2, 1)), [[1.0, 1e-20]])
    assert not nothing_goes_on(system, np.array([0.0, 1.0]), 0.0)
    assert nothing_goes_on(system, np.array([0.0, -1.0]), 0.0)


@pytest.mark.parametrize("method", ["event-driven", TimeStepping("implicit-euler", step=0.01)])
def test_where_a_motion_has_come_to_nothing_is_proved(method):
    """x' = -1, y = x: from 1/2 there is no way on at t = 1/2, where x is known to rounding alone."""
    system = LCS([[0.0]], [[0.0]], [[1.0]], f=[-1.0])
    with pytest.raises(NotFoundError):
        simulate(system, [0.5], (0.0, 1.0), method=method)
    with pytest.raises(InfeasibleError, match="proved"):
        simulate(system, [-1e-300], (0.0, 1.0), method=method)


def test_the_input_is_taken_as_it_varies_from_where_it_is_known():
    falling = LCS([[0.0]], [[0.0]], [[0.0]], g=sine(-1.0, 1.0))
    assert nothing_goes_on(falling, np.zeros(1), 0.0)
    assert not nothing_goes_on(falling, np.zeros(1), 1.0)  # sin 2 pi is known to rounding
    constant = LCS([[0.0]], [[0.0]], [[0.0]], g=[-1e-300])
    assert nothing_goes_on(constant, np.zeros(1), 1.0)
