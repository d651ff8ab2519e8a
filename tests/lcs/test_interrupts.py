"""An interrupt of the keyboard ends every simulation soon, whatever its method."""

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.lcs.classes import column
from pricing_core.lcs import LCS, TimeStepping, simulate, sine
from pricing_core.models import MechanicalSystem
from tests.problems.interrupted import seconds_until_interrupted

FOREVER = (0.0, 1e6)
SOON = 2.0  # seconds of processor time; a few milliseconds on most machines

RECTIFIER = LCS([[-10.0]], [[1.0]], [[1.0]], [[1.0]], g=sine([-10.0], 50.0))
BALL = MechanicalSystem([[1.0]], [[0.0]], [[0.0]], [[1.0]], force=[-9.81], restitution=1.0)


def many_pairs(k: int) -> LCS:
    """Return a passive system that never comes to rest."""
    rng = np.random.default_rng(0)
    S, C, K = rng.normal(size=(k, k)), rng.normal(size=(k, k)), rng.normal(size=(k, k))
    return LCS(S - S.T - np.eye(k), C.T, C, K - K.T + np.eye(k), f=sine(rng.normal(size=k), 0.7))


LONG: dict[str, Callable[[], object]] = {
    "one pair, from event to event": lambda: simulate(RECTIFIER, [0.0], FOREVER),
    "many pairs, from event to event": lambda: simulate(many_pairs(20), np.ones(20), FOREVER),
    "a bouncing ball": lambda: BALL.simulate([1.0], [0.0], FOREVER),
    "a column of beads": lambda: column(np.random.default_rng(3), 40).run(lambda: False),
    "impulses": lambda: BALL.simulate([1.0], [0.0], FOREVER, method=TimeStepping(step=1e-3)),
    "a tolerance": lambda: simulate(RECTIFIER, [0.0], (0.0, 1e3), method="time-stepping"),
    "many pairs in steps": lambda: simulate(
        many_pairs(20), np.ones(20), FOREVER, method=TimeStepping("implicit-euler", step=1e-2)
    ),
    **{
        scheme: lambda scheme=scheme: simulate(
            RECTIFIER, [0.0], FOREVER, method=TimeStepping(scheme, step=1e-3)
        )
        for scheme in ("implicit-euler", "theta", "sdirk2")
    },
}


@pytest.mark.parametrize("name", LONG)
def test_an_interrupt_ends_the_simulation(name):
    assert seconds_until_interrupted(LONG[name], after=0.2) < SOON
