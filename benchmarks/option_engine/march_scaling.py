"""What does the march itself cost by its steps, and what does it leave as an error?"""

from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from pricing_core.american.engines.premium_march.flat_contracts import Puts
from pricing_core.american.engines.premium_march.puts import MOST_STEPS, PutValues, solve_puts

STEP_COUNTS = (8, 16, 32, 64, 128)  # each with the marches of half and a quarter of the steps
MARCHES = (1, 2, 4)  # What the steps of the three marches are divided by.
FAR = 1e-8  # Tolerance that the width of the grid is chosen for.


class MarchCost(NamedTuple):
    """Three marches per option, with `steps`, half and a quarter of them, extrapolated.

    `nanoseconds` is the time of one step of any of the three, on a grid that is the wider the more steps they take;
    `cycles` the same at the processor's nominal clock (None where it is not known).
    """

    steps: int
    microseconds: float
    with_derivatives: float
    rmse: float
    nanoseconds: float
    cycles: float | None


def march_costs(count: int, megahertz: float | None) -> tuple[MarchCost, ...]:
    """Measure `count` random puts at each number of steps, one thread.

    Parameters
    ----------
    count : int
        Puts, all of them held.
    megahertz : float or None
        The processor's nominal clock.
    """
    puts = _held_puts(count)
    reference = _solve(puts, MOST_STEPS).values[0]
    derivatives = np.full((puts.x.size, 7), np.inf)
    tasks = [
        Task((partial(_solve, puts, steps, wanted),))
        for steps in STEP_COUNTS
        for wanted in (None, derivatives)
    ]
    seconds = iter(least_seconds(tasks))
    costs = []
    for steps in STEP_COUNTS:
        microseconds, with_derivatives = (1e6 * next(seconds) / puts.x.size for _ in range(2))
        error = _solve(puts, steps).values[0] - reference
        nanoseconds = 1e3 * microseconds / sum(steps // part for part in MARCHES)
        costs.append(
            MarchCost(
                steps,
                microseconds,
                with_derivatives,
                float(np.sqrt(np.mean(error**2))),
                nanoseconds,
                None if megahertz is None else nanoseconds * megahertz / 1e3,
            )
        )
    return tuple(costs)


def _held_puts(count: int) -> Puts:
    random = np.random.default_rng(20)
    expiry = random.uniform(0.05, 2.0, 4 * count)
    rate, dividend = (
        random.uniform(0.01, 0.1, 4 * count) * expiry,
        random.uniform(0.0, 0.1, 4 * count) * expiry,
    )
    spread = random.uniform(0.1, 0.5, 4 * count) * np.sqrt(expiry)
    puts = Puts(random.uniform(-0.3, 0.3, 4 * count), rate, dividend, spread)
    found = _solve(puts, MOST_STEPS)
    held = np.flatnonzero(found.settled & ~found.exercised)
    return puts.take(held[:count])


def _solve(puts: Puts, steps: int, limits: np.ndarray | None = None) -> PutValues:
    tolerance = np.full(puts.x.size, FAR)
    return solve_puts(puts, tolerance, limits=limits, fewest=steps, most=steps)
