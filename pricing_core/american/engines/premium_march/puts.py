"""Puts to a tolerance, many at once, in the dimensionless parameters of the kernel's march.

docs/premium_march.md tells the scheme: r T, q T and sigma sqrt(T) of a put; a call is the put with spot and
strike, and rate and yield, exchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.engines.premium_march.flat_contracts import Puts
from pricing_core.arrays import BoolVector, Matrix, Vector

FEWEST_STEPS, MOST_STEPS = 4, 384  # Limits of the number of time steps of a put's finest march; calibrated.
BOUNDARY_STEPS = (8, 16, 32, 64, 128, 256)  # Numbers of time steps of the marches to a boundary.
BOUNDARY_GAIN = 4.0  # Difference of two marches over the finer one's error; calibrated.
# Share of the difference before the last that counts as error: two marches may agree by accident; calibrated.
FAR_SHARE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class PutValues:
    """The values that the marches of n puts give.

    Parameters
    ----------
    values : Matrix, shape (7, n)
        v = V/K, v_x, v_xx, the European v, and the derivatives of v by r T, q T and sigma sqrt(T).
    error : Vector, shape (n,)
        Error estimate of v, rounding left out.
    boundary : Vector, shape (n,)
        ln(S*/K).
    exercised : bool array, shape (n,)
        Whether x lies in the exercise region.
    settled : bool array, shape (n,)
        False where the march does not serve the put, or lost the boundary; nothing in that row may be used.
    steps : int array, shape (n,)
        Time steps of the finest march; 0 where the march does not serve the put.
    """

    values: Matrix
    error: Vector
    boundary: Vector
    exercised: BoolVector
    settled: BoolVector
    steps: NDArray[np.int64]


def solve_puts(
    puts: Puts,
    tolerance: Vector,
    *,
    limits: Matrix | None,
    threads: int = 1,
    fewest: int = FEWEST_STEPS,
    most: int = MOST_STEPS,
    interrupt: Callable[[], bool] | None = None,
) -> PutValues:
    """Refine every put until its stated error meets its tolerance, or to the finest mesh.

    Parameters
    ----------
    puts : Puts
    tolerance : Vector, shape (n,)
        Tolerance of v.
    limits : Matrix, shape (n, 7), or None
        What each of the values may be off by; puts that miss are refined, too, up to 96 steps. None leaves out the
        derivatives by the parameters.
    threads : int
    fewest, most : int
        Bounds of the number of time steps of the finest march.
    interrupt : callable, optional
        Asked every few milliseconds; True ends the work. Puts not marched yet are not settled then, and those whose
        error still misses the tolerance stay as they are.
    """
    numbers, exercised, settled, steps = kernel.solve_puts(
        puts.x, puts.rate, puts.dividend, puts.spread, np.arange(puts.x.size + 1), tolerance, limits,
        None, fewest, most, threads, interrupt,
    )  # fmt: skip
    return PutValues(numbers[:, :7].T, numbers[:, 7], numbers[:, 8], exercised, settled, steps)


def solve_boundaries(
    puts: Puts, accuracy: float, interrupt: Callable[[], bool] | None = None
) -> tuple[Vector, Vector, BoolVector]:
    """Return ln(S*/K) now, its stated error and whether the march was settled, each of shape (n,).

    Parameters
    ----------
    puts : Puts
        x plays no part.
    accuracy : float
        Accuracy of the boundary relative to itself; each row is refined until it is met, or to the finest mesh.
    interrupt : callable, optional
        Asked every few milliseconds; True ends the work, and what is not marched then is not settled.
    """
    boundary, error = np.full(puts.x.size, np.nan), np.full(puts.x.size, np.inf)
    settled = np.zeros(puts.x.size, dtype=bool)
    rows = np.arange(puts.x.size)
    quarter, half = (_boundaries(steps, puts, interrupt) for steps in BOUNDARY_STEPS[:2])
    for steps in BOUNDARY_STEPS[2:]:
        whole = _boundaries(steps, puts.take(rows), interrupt)
        near, far = whole[0] - half[0], half[0] - quarter[0]
        boundary[rows] = whole[0] + near / BOUNDARY_GAIN
        error[rows] = np.abs(near) + FAR_SHARE * np.abs(far)
        settled[rows] = whole[1] & half[1] & quarter[1]
        missed = np.flatnonzero(~(settled[rows] & (error[rows] <= accuracy)))
        if not missed.size:
            break
        rows = rows[missed]
        quarter, half = (half[0][missed], half[1][missed]), (whole[0][missed], whole[1][missed])
    return boundary, error, settled


def _boundaries(steps: int, puts: Puts, interrupt: Callable[[], bool] | None) -> tuple[Vector, BoolVector]:
    return kernel.march_boundaries(steps, puts.rate, puts.dividend, puts.spread, interrupt)
