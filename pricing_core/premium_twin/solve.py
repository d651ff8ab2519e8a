"""Many puts to their tolerances, in NumPy: the reference of the compiled kernel.

A put is marched with M, M/2 and M/4 time steps. That gives an extrapolant and two differences; the error is stated
as 0.25 |v - v_half| + 0.05 |v_half - v_quarter|, the second difference being about six times the first, and at least
0.4 times the difference of the slopes by xi: that keeps an accidental agreement of marches from being believed. With
fewer than 8 steps there is no third march, and 2 |v - v_half| stands for the sum. Where the error is too large, the
put is marched with 2 M steps as well, and so on.
"""

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.premium_twin.march import march
from pricing_core.premium_twin.mesh import COARSEST_CHECKED, STEPS, classify, mesh_of
from pricing_core.premium_twin.reading import Sight, Spots

# What the difference of two marches is to the finer one's error; without a third march half the steps are too few
# for that law.
GAIN, LONE_GAIN, BOUNDARY_GAIN = 5.5, 12.0, 4.0
NEAR_SHARE, FAR_SHARE, LONE_SHARE, SLOPE_SHARE = 0.25, 0.05, 2.0, 0.4
# The law of those differences does not hold yet with the fewest steps that allow three marches.
COARSE_FACTOR = 2.0
DERIVATIVE_SHARE = 0.17  # of the difference of two marches, for the derivatives' error after extrapolation
MOST_STEPS_FOR_DERIVATIVES = 96
STEPS_TO_SETTLE = 96  # a march that loses the boundary with so many is not refined further
BOUNDARY_TOLERANCE = 1e-8  # for the width of the grid

Solved = tuple[Matrix, BoolVector, BoolVector, NDArray[np.int64]]


def solve_puts(
    x: Vector,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    first: NDArray[np.int64],
    tolerance: Vector,
    limits: Matrix | None,
    fewest: int,
    most: int,
    threads: int,
) -> Solved:
    """Refine every put until its stated error meets its tolerance, or to the finest mesh.

    Parameters
    ----------
    x : Vector, shape (n,)
        ln(S/K).
    rate, dividend, spread : Vector, shape (runs,)
        r T, q T and sigma sqrt(T) of runs of spots, which share their marches.
    first : int array, shape (runs + 1,)
        The first spot of each run, and n.
    tolerance : Vector, shape (n,)
        Of V/K.
    limits : Matrix, shape (n, 7), or None
        What each of the values may be off by; puts that miss are refined, too, up to 96 steps. None leaves out the
        derivatives by rate, dividend and spread.
    fewest, most : int
        Bounds of the number of time steps of the finest march: of `STEPS`, at least 4.
    threads : int
        Not used here; the compiled kernel splits the runs among so many.

    Returns
    -------
    numbers : Matrix, shape (9, n)
        v = V/K, v_x, v_xx, the European v, dv/drate, dv/ddividend, dv/dspread at fixed x, without rounding those of
        the payoff in the exercise region; the error of v; ln(S*/K).
    exercised, settled : bool array, shape (n,)
        Whether x is in the exercise region; False where x is not finite, or the march does not serve or lost the
        boundary: nothing of that spot may be used.
    steps : int array, shape (n,)
        Of the finest march; 0 where the march does not serve.
    """
    del threads
    solving = _Solving(x, (rate, dividend, spread), first, tolerance, limits, STEPS.index(most))
    with np.errstate(all="ignore"):
        tightest = np.minimum.reduceat(tolerance, first[:-1]) if rate.size else tolerance
        classes = classify(rate, dividend, spread, tightest)
        level = np.clip(classes.level, STEPS.index(fewest), STEPS.index(most))
        keys = np.stack([classes.distance, classes.decay, level])[:, classes.served]
        for key in np.unique(keys, axis=1).T:
            runs = np.flatnonzero(classes.served)[np.all(keys == key[:, None], axis=0)]
            solving.refine(runs, *key.tolist())
    return solving.numbers, solving.exercised, solving.settled, solving.steps


class _Solving:
    """The puts and what is found of them."""

    def __init__(
        self,
        x: Vector,
        parameters: tuple[Vector, Vector, Vector],
        first: NDArray[np.int64],
        tolerance: Vector,
        limits: Matrix | None,
        finest: int,
    ) -> None:
        self.x, self.parameters, self.tolerance, self.limits = x, parameters, tolerance, limits
        self.run = np.repeat(np.arange(first.size - 1), np.diff(first))  # of each spot
        self.finest = finest
        self.numbers = np.full((9, x.size), np.nan)
        self.exercised, self.settled = np.zeros((2, x.size), dtype=bool)
        self.steps = np.zeros(x.size, dtype=np.int64)

    def refine(self, runs: NDArray[np.intp], distance: int, decay: int, level: int) -> None:
        """March the runs of one class and level, and on where that is not enough."""
        spots = np.flatnonzero(np.isin(self.run, runs) & np.isfinite(self.x))
        differentiate = self.limits is not None
        quarter = None
        if level >= COARSEST_CHECKED:
            quarter = self._look(spots, distance, decay, level - 4, False)
        half = self._look(spots, distance, decay, level - 2, differentiate)
        while spots.size:
            whole = self._look(spots, distance, decay, level, differentiate)
            missed = self._judge(spots, level, whole, half, quarter)
            if level + 2 > self.finest:
                break
            spots, level = spots[missed], level + 2
            quarter, half = half.take(missed), whole.take(missed)

    def _look(
        self, spots: NDArray[np.intp], distance: int, decay: int, level: int, differentiate: bool
    ) -> Sight:
        runs, row = np.unique(self.run[spots], return_inverse=True)
        marched = march(
            mesh_of(distance, decay, level), differentiate, *(column[runs] for column in self.parameters)
        )
        return self._spots(spots).look(marched, row)

    def _spots(self, spots: NDArray[np.intp]) -> Spots:
        return Spots(self.x[spots], *(column[self.run[spots]] for column in self.parameters))

    def _judge(
        self, spots: NDArray[np.intp], level: int, whole: Sight, half: Sight, quarter: Sight | None
    ) -> NDArray[np.intp]:
        """Extrapolate, state the error, store both, and return which of the spots need more."""
        reading = self._spots(spots)
        near = whole.u - half.u
        differences = reading.differences(near)
        settled = whole.settled & half.settled
        if quarter is None:
            error = LONE_SHARE * np.abs(differences[0])
        else:
            before = np.abs(reading.bond * (half.u[0] - quarter.u[0]))
            error = NEAR_SHARE * np.abs(differences[0]) + FAR_SHARE * before
            if level == COARSEST_CHECKED:
                error *= COARSE_FACTOR
            settled = settled & quarter.settled
        error = np.maximum(error, SLOPE_SHARE * np.abs(reading.bond * near[1]))
        # Just inside the exercise region: what the value exceeds the payoff by if the boundary is that far off.
        moved, inside = whole.boundary - half.boundary, whole.boundary - reading.x
        shortfall = np.maximum(np.abs(moved) - inside, 0.0)
        excess = shortfall**2 * reading.rate / reading.spread**2
        error = np.where(inside >= 0.0, np.maximum(error, excess), error)
        # Beyond the grid u is taken for zero.
        lost = reading.premium_bound(whole.boundary)
        error = np.where(whole.u[0] == 0.0, np.maximum(error, lost), error)

        boundary = whole.boundary + moved / BOUNDARY_GAIN
        gain = LONE_GAIN if quarter is None else GAIN
        self.numbers[:7, spots] = reading.values(whole.u + near / gain, boundary)
        self.numbers[7, spots], self.numbers[8, spots] = error, boundary
        self.exercised[spots], self.settled[spots] = reading.x <= boundary, settled
        self.steps[spots] = STEPS[level]
        met = settled & (error <= self.tolerance[spots])
        if self.limits is not None and STEPS[level] < MOST_STEPS_FOR_DERIVATIVES:
            met &= np.all(DERIVATIVE_SHARE * np.abs(differences.T) <= self.limits[spots], axis=1)
        hopeless = ~whole.settled & (STEPS[level] >= STEPS_TO_SETTLE)
        return np.flatnonzero(~met & ~hopeless)


def march_boundaries(steps: int, rate: Vector, dividend: Vector, spread: Vector) -> tuple[Vector, BoolVector]:
    """Return ln(S*/K) now and whether it was found, from one march with so many of `STEPS` each.

    Parameters
    ----------
    steps : int
    rate, dividend, spread : Vector, shape (n,)
        r T, q T, sigma sqrt(T) of a put.
    """
    level = STEPS.index(steps)
    boundary, settled = np.full(rate.size, np.nan), np.zeros(rate.size, dtype=bool)
    classes = classify(rate, dividend, spread, np.full(rate.size, BOUNDARY_TOLERANCE))
    keys = np.stack([classes.distance, classes.decay])[:, classes.served]
    for key in np.unique(keys, axis=1).T:
        rows = np.flatnonzero(classes.served)[np.all(keys == key[:, None], axis=0)]
        mesh = mesh_of(int(key[0]), int(key[1]), level)
        marched = march(mesh, False, rate[rows], dividend[rows], spread[rows])
        boundary[rows], settled[rows] = marched.boundary, marched.settled
    return boundary, settled
