"""The chapter's road and Crank-Nicolson beside the averaged march: what does an error of a put cost with each?

One put by the nodal discretisation (11.62)-(11.64), an LCP for each stage by policy iteration, stepped by implicit
Euler (11.65), SDIRK2, Crank-Nicolson with and without Rannacher's start and with step-size control; and by the march
with the averaged complementarity function. Cost is the number of nodes times the number of implicit stages: the
largest error in V over five prices, and in V_xx next to the strike. Run from the root of the project:
.venv/bin/python -m benchmarks.nodal_methods
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.reporting.report import table
from pricing_core.american import Market, Option, price
from pricing_core.obstacle import Diffusion, Obstacle, ObstacleProblem, nodal_method
from pricing_core.obstacle.grid import Grid, GridMap
from pricing_core.obstacle.march import march
from pricing_core.stepping import (
    IMPLICIT_EULER,
    SDIRK2,
    FixedStep,
    PIController,
    StepDoubling,
    Tableau,
    integrate,
    theta_method,
)

RATE, VOLATILITY, EXPIRY = 0.05, 0.2, 1.0
SPOTS = np.array([0.85, 0.95, 1.0, 1.05, 1.2])
HALF_WIDTH = 5.5 * VOLATILITY
CELLS = (64, 128, 256, 512, 1024)
STEPS_FOR_CELLS = (0.125, 0.25, 0.5, 1.0)


class Run(NamedTuple):
    """One solution: its cost in nodes times stages, and its largest errors."""

    cost: int
    error: float
    bend_error: float


class Cheapest(NamedTuple):
    """The cost of a method's cheapest run within each error; the least error of all, and the error in V_xx there."""

    method: str
    at_1e_3: int | None
    at_1e_4: int | None
    at_1e_5: int | None
    at_1e_6: int | None
    least_error: float
    its_error_in_V_xx: float


def put() -> ObstacleProblem:
    """Return an American put with strike 1 over x = ln S."""
    payoff = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
    diffusion = Diffusion(VOLATILITY, RATE - VOLATILITY**2 / 2.0, RATE)
    return ObstacleProblem(diffusion, payoff, EXPIRY, lower=payoff, ends=("exponential", "exponential"))


def truth() -> tuple[np.ndarray, float]:
    """Return V at SPOTS and V_xx at the strike, by the option engine."""
    found = [price(Option("put", 1.0, EXPIRY), Market(s, RATE, VOLATILITY), tolerance=1e-8) for s in SPOTS]
    at = price(Option("put", 1.0, EXPIRY), Market(1.0, RATE, VOLATILITY), tolerance=1e-8, greeks="standard")
    assert at.gamma is not None
    assert at.delta is not None
    return np.array([one.price for one in found]), at.gamma + at.delta


def nodal(
    tableau: Tableau, *, rannacher: bool = False
) -> Callable[[int, int], tuple[np.ndarray, np.ndarray, int]]:
    """Return what gives x, V and the number of stages of a nodal method with equal steps."""

    def run(cells: int, steps: int) -> tuple[np.ndarray, np.ndarray, int]:
        damped = 2.0 * EXPIRY / steps if rannacher else 0.0
        method, state, x = nodal_method(
            put(), cells - 1, (-HALF_WIDTH, HALF_WIDTH), tableau=tableau, damped_until=damped
        )
        found = integrate(method, state, (0.0, EXPIRY), controller=FixedStep(EXPIRY / steps))
        stages = steps * sum(row != (0.0,) for row in tableau.a) + (2 if rannacher else 0)
        return x, found.states[-1].value, stages

    return run


def controlled(cells: int, steps: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return x, V and the number of stages of SDIRK2 with step-size control by doubling."""
    method, state, x = nodal_method(put(), cells - 1, (-HALF_WIDTH, HALF_WIDTH), tableau=SDIRK2)
    tolerance = 0.1 / steps**2
    found = integrate(StepDoubling(method), state, (0.0, EXPIRY), controller=PIController(0.0, tolerance))
    return x, found.states[-1].value, 6 * (found.t.size - 1 + found.rejected)


def averaged(cells: int, steps: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return x, V and the number of stages of the march, which has steps of its own."""
    found = march(put(), Grid.of(GridMap(-HALF_WIDTH, HALF_WIDTH, cells), 1))
    assert found is not None
    return found.grid.x, found.now.value, 3 * sum(found.steps)


METHODS: dict[str, Callable[[int, int], tuple[np.ndarray, np.ndarray, int]]] = {
    "implicit Euler (11.65)": nodal(IMPLICIT_EULER),
    "SDIRK2": nodal(SDIRK2),
    "SDIRK2, steps controlled": controlled,
    "Crank-Nicolson": nodal(theta_method(0.5)),
    "Crank-Nicolson, Rannacher's start": nodal(theta_method(0.5), rannacher=True),
    "averaged march": averaged,
}


def runs(method: Callable[[int, int], tuple[np.ndarray, np.ndarray, int]]) -> Iterator[Run]:
    """Run a method on all grids with all numbers of steps."""
    true, bend = truth()
    for cells in CELLS:
        for share in STEPS_FOR_CELLS if method is not averaged else (1.0,):
            x, V, stages = method(cells, round(share * cells))
            h, middle = x[1] - x[0], int(np.argmin(np.abs(x)))
            second = float(V[middle - 1] - 2.0 * V[middle] + V[middle + 1]) / h**2
            found = _interpolated(x, V, np.log(SPOTS))
            yield Run(cells * stages, float(np.abs(found - true).max()), abs(second - bend))


def _interpolated(x: np.ndarray, V: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return V at places by polynomials through four nodes."""
    start = np.clip(np.searchsorted(x, at) - 2, 0, x.size - 4)
    total = np.zeros(at.size)
    for k in range(4):
        others = [j for j in range(4) if j != k]
        weight = math.prod((at - x[start + j]) / (x[start + k] - x[start + j]) for j in others)
        total += weight * V[start + k]
    return total


def cheapest(name: str) -> Cheapest:
    """Return what each error costs with a method."""
    found = list(runs(METHODS[name]))
    best = min(found, key=lambda run: run.error)

    def cost(goal: float) -> int | None:
        return min((run.cost for run in found if run.error <= goal), default=None)

    return Cheapest(name, cost(1e-3), cost(1e-4), cost(1e-5), cost(1e-6), best.error, best.bend_error)


def main() -> None:
    """Print the table."""
    print(table("cost", [cheapest(name) for name in METHODS]))


if __name__ == "__main__":
    main()
