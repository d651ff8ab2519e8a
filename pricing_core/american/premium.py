"""Puts to a tolerance, many at once: which meshes, how far to refine, what error to state.

Works in the dimensionless parameters of the kernel's march (`pricing_core.premium_twin.march` tells the scheme):
r T, q T and sigma sqrt(T) of a put; a call is the put with spot and strike, and rate and yield, exchanged.

The error of one march with M steps falls like M**-2.6. Three marches, with M, M/2 and M/4 steps and nodes in
proportion, give the extrapolant v + (v - v_half)/6 and two differences; the error is stated as
0.4 |v - v_half| + 0.13 |v_half - v_quarter|: the second difference is about six times the first, and keeps an
accidental agreement of two marches from being believed. With fewer than 8 steps there is no third march, and the
error is stated as 2 |v - v_half|.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.tolerances import SMALLEST_TOLERANCE
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.kernel import premium_march, premium_values, profile_values

STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)
BOUNDARY_COARSEST = 8  # of the levels, for the boundary alone: 32 steps
BOUNDARY_TOLERANCE = 1e-8  # for the width of the grid
COARSEST = 2  # index of the fewest steps whose half is there
COARSEST_CHECKED = 4  # of those whose quarter is there, too
LOOSE_TOLERANCE = 1e-4  # from which on two marches are enough
GAIN = 6.0  # of halving the steps, 2**2.6
BOUNDARY_GAIN, BOUNDARY_SHARE = 3.0, 1.0  # the boundary converges at order 2
NEAR_SHARE, FAR_SHARE, LONE_SHARE = 0.4, 0.13, 2.0
DERIVATIVE_SHARE = 0.25  # of the distance of two marches, for the derivatives' error after extrapolation
MOST_STEPS_FOR_DERIVATIVES = 96
STEPS_TO_SETTLE = 96  # a march that loses the boundary with so many is not refined further
WIDTH = 0.75  # dx sqrt(M): wider, and the compact scheme loses the signs of an M-matrix
TYPICAL_ERROR = 7e-5  # of a march with 16 steps at r T = 1: four in five are better
TYPICAL_POWER = 1.3  # with which it grows with r T
NODES_STEP = 4  # the number of nodes is a multiple of it, that rows find company in their lanes
LAYER = 0.7  # dx at most this share of the length over which the premium decays
LAYERS = 20.0  # of those lengths in the grid
LARGEST_GROWTH, LARGEST_SPREAD, SMALLEST_SPREAD = 3.0, 4.0, 1e-7
SMALLEST_RATE = 1e-9
MOST_HALVINGS = 4  # of the coarsest cells
LARGEST_DISTANCE = 40.0  # in xi, from the boundary to the end of the grid


@dataclass(frozen=True, slots=True, eq=False)
class Puts:
    """Dimensionless parameters of puts; every field has shape (n,).

    Parameters
    ----------
    x : Vector
        ln(S/K).
    rate, dividend, spread : Vector
        r T, q T, sigma sqrt(T).
    """

    x: Vector
    rate: Vector
    dividend: Vector
    spread: Vector

    def take(self, rows: NDArray[np.intp]) -> "Puts":
        """Return some of them."""
        return Puts(self.x[rows], self.rate[rows], self.dividend[rows], self.spread[rows])

    def drift(self) -> Vector:
        """Return (r - q - sigma**2/2) sqrt(T)/sigma."""
        return (self.rate - self.dividend) / self.spread - 0.5 * self.spread

    def decay(self) -> Vector:
        """Return lam in the stationary premium e^{-lam ln(S/K)/(sigma sqrt(T))}."""
        drift = self.drift()
        return drift + np.sqrt(drift * drift + 2.0 * self.rate)


@dataclass(frozen=True, slots=True, eq=False)
class PutValues:
    """What the marches say of each put.

    Parameters
    ----------
    values : Matrix, shape (n, 7)
        v = V/K, v_x, v_xx, the European v, and the derivatives of v by r T, q T and sigma sqrt(T).
    error : Vector, shape (n,)
        Of v, rounding left out.
    boundary : Vector, shape (n,)
        ln(S*/K).
    exercised : bool array, shape (n,)
        Whether x lies in the exercise region.
    settled : bool array, shape (n,)
        False where a march lost the boundary; nothing in that row may be used.
    steps : int array, shape (n,)
        Time steps of the finest march.
    """

    values: Matrix
    error: Vector
    boundary: Vector
    exercised: BoolVector
    settled: BoolVector
    steps: NDArray[np.int64]


def is_served(puts: Puts) -> BoolVector:
    """Whether the march can take the put: one boundary, and layers the grid can resolve."""
    with np.errstate(all="ignore"):
        inside = (
            (puts.rate >= SMALLEST_RATE)
            & (puts.rate <= LARGEST_GROWTH)
            & (np.abs(puts.dividend) <= LARGEST_GROWTH)
            & (puts.spread >= SMALLEST_SPREAD)
            & (puts.spread <= LARGEST_SPREAD)
        )
        decay = puts.decay()
        resolved = _halvings(decay, WIDTH / np.sqrt(STEPS[COARSEST])) <= MOST_HALVINGS
        near = _distance(puts, np.full(puts.x.size, SMALLEST_TOLERANCE), decay) <= LARGEST_DISTANCE
        return inside & resolved & near


def solve_puts(
    puts: Puts, tolerance: Vector, *, limits: Matrix | None, threads: int, shared: bool = False
) -> PutValues:
    """Refine every put until its stated error meets its tolerance, or to the finest mesh.

    Parameters
    ----------
    puts : Puts
        All of them served.
    tolerance : Vector, shape (n,)
        Of v.
    limits : Matrix, shape (n, 7), or None
        What each of the values may be off by; rows that miss are refined, too, up to 96 steps. None leaves out the
        derivatives by the parameters.
    threads : int
    shared : bool
        Whether neighbouring rows that differ in x alone share their marches.
    """
    marches: _Marches = (
        _SharedMarches(puts, tolerance, threads) if shared else _Marches(puts, tolerance, threads)
    )
    count = puts.x.size
    out = PutValues(
        np.full((count, 7), np.nan),
        np.full(count, np.inf),
        np.full(count, np.nan),
        np.zeros(count, dtype=bool),
        np.ones(count, dtype=bool),
        np.zeros(count, dtype=np.int64),
    )
    level = _first_level(puts, marches.tolerance)
    for first in np.flatnonzero(np.bincount(level)):
        _refine(marches, np.flatnonzero(level == first), int(first), tolerance, limits, out)
    return out


def solve_boundaries(puts: Puts, accuracy: float) -> tuple[Vector, Vector, BoolVector]:
    """Return ln(S*/K) now, its stated error and whether the march was settled, each of shape (n,).

    Parameters
    ----------
    puts : Puts
        All of them served; x plays no part.
    accuracy : float
        Of the boundary relative to itself; each row is refined until it is met, or to the finest mesh.
    """
    boundary, error = np.full(puts.x.size, np.nan), np.full(puts.x.size, np.inf)
    settled = np.zeros(puts.x.size, dtype=bool)
    marches = _Marches(puts, np.full(puts.x.size, BOUNDARY_TOLERANCE), 1)
    rows, level = np.arange(puts.x.size), BOUNDARY_COARSEST
    quarter, half = (marches.march(rows, level - back, False) for back in (4, 2))
    while rows.size:
        whole = marches.march(rows, level, False)
        near, far = whole.boundary - half.boundary, half.boundary - quarter.boundary
        boundary[rows] = whole.boundary + near / BOUNDARY_GAIN
        error[rows] = BOUNDARY_SHARE * (np.abs(near) + np.abs(far) / BOUNDARY_GAIN**2)
        settled[rows] = whole.settled & half.settled & quarter.settled
        if level + 2 >= len(STEPS):
            break
        missed = np.flatnonzero(~(settled[rows] & (error[rows] <= accuracy)))
        rows, level = rows[missed], level + 2
        quarter, half = half.take(missed), whole.take(missed)
    return boundary, error, settled


def _first_level(puts: Puts, tolerance: Vector) -> NDArray[np.intp]:
    """Return the index of the steps that four in five puts need no more than."""
    typical = TYPICAL_ERROR * np.minimum(puts.rate, 1.0) ** TYPICAL_POWER
    steps = 16.0 * (typical / tolerance) ** (1.0 / np.log2(GAIN))
    fewest = np.where(tolerance >= LOOSE_TOLERANCE, COARSEST, COARSEST_CHECKED)
    return np.asarray(np.clip(np.searchsorted(STEPS, steps), fewest, len(STEPS) - 1))


def _refine(
    marches: "_Marches",
    rows: NDArray[np.intp],
    level: int,
    tolerance: Vector,
    limits: Matrix | None,
    out: PutValues,
) -> None:
    tangents = limits is not None
    quarter = None if level < 4 else marches.march(rows, level - 4, False)
    half = marches.march(rows, level - 2, tangents)
    while rows.size:
        whole = marches.march(rows, level, tangents)
        error, settled = _stated_error(whole, half, quarter)
        # Just inside the exercise region: what the value exceeds the payoff by if the boundary is that far off.
        shortfall = np.abs(whole.boundary - half.boundary) - (whole.boundary - marches.puts.x[rows])
        excess = np.maximum(shortfall, 0.0) ** 2 * marches.puts.rate[rows] / marches.puts.spread[rows] ** 2
        error = np.maximum(error, np.where(whole.exercised, excess, 0.0))
        boundary = whole.boundary + (whole.boundary - half.boundary) / BOUNDARY_GAIN
        where = slice(None) if rows.size == out.steps.size else rows  # copying is faster than scattering
        out.values[where] = whole.values + (whole.values - half.values) / GAIN
        out.error[where], out.settled[where] = error, settled
        out.boundary[where] = boundary
        out.exercised[where] = marches.puts.x[rows] <= boundary
        out.steps[where] = STEPS[level]
        if level + 2 >= len(STEPS):
            break
        met = settled & (error <= tolerance[rows])
        if limits is not None and STEPS[level] < MOST_STEPS_FOR_DERIVATIVES:
            near = np.abs(whole.values - half.values)
            met &= np.all(DERIVATIVE_SHARE * near <= limits[rows], axis=1) | (
                whole.exercised & half.exercised
            )
        hopeless = ~whole.settled if STEPS[level] >= STEPS_TO_SETTLE else np.zeros(rows.size, dtype=bool)
        missed = np.flatnonzero(~(met | hopeless))
        rows, level = rows[missed], level + 2
        quarter, half = half.take(missed), whole.take(missed)


@dataclass(frozen=True, slots=True, eq=False)
class _Marched:
    values: Matrix
    boundary: Vector
    settled: BoolVector
    exercised: BoolVector

    def take(self, rows: NDArray[np.intp]) -> "_Marched":
        return _Marched(self.values[rows], self.boundary[rows], self.settled[rows], self.exercised[rows])


def _stated_error(whole: _Marched, half: _Marched, quarter: _Marched | None) -> tuple[Vector, BoolVector]:
    """Return the error of the extrapolant, and whether all marches behind it are settled."""
    near = np.abs(whole.values[:, 0] - half.values[:, 0])
    settled = whole.settled & half.settled
    if quarter is None:
        return LONE_SHARE * near, settled
    far = np.abs(half.values[:, 0] - quarter.values[:, 0])
    return NEAR_SHARE * near + FAR_SHARE * far, settled & quarter.settled


class _Marches:
    """A march of its own for every row."""

    def __init__(self, puts: Puts, tolerance: Vector, threads: int) -> None:
        self.puts, self.tolerance, self.threads = puts, tolerance, threads
        self.decay = puts.decay()
        self.distance = _distance(puts, tolerance, self.decay)

    def march(self, rows: NDArray[np.intp], level: int, tangents: bool) -> _Marched:
        """Return what the march with so many steps says of these rows."""
        puts = self.puts if rows.size == self.puts.x.size else self.puts.take(rows)
        mesh = _Mesh(self.decay[rows], self.distance[rows], STEPS[level])
        values, boundary, settled = premium_values(
            mesh.steps, mesh.width, puts.x, puts.rate, puts.dividend, puts.spread, mesh.nodes, mesh.halvings,
            tangents, self.threads,
        )  # fmt: skip
        return _Marched(values, boundary, settled, puts.x <= boundary)


class _SharedMarches(_Marches):
    """One march for every run of rows that differ in x alone."""

    def __init__(self, puts: Puts, tolerance: Vector, threads: int) -> None:
        parameters = np.stack([puts.rate, puts.dividend, puts.spread])
        starts = np.append(True, np.any(parameters[:, 1:] != parameters[:, :-1], axis=0))
        self.run = np.cumsum(starts) - 1  # of each row
        self.first = np.flatnonzero(starts)
        super().__init__(puts, np.minimum.reduceat(tolerance, self.first)[self.run], threads)

    def march(self, rows: NDArray[np.intp], level: int, tangents: bool) -> _Marched:
        """Return what the march with so many steps says of these rows."""
        runs, row = np.unique(self.run[rows], return_inverse=True)
        heads = self.first[runs]
        puts = self.puts.take(heads)
        mesh = _Mesh(self.decay[heads], self.distance[heads], STEPS[level])
        profiles, frame, boundary, settled = premium_march(
            mesh.steps, mesh.width, puts.rate, puts.dividend, puts.spread, mesh.nodes, mesh.halvings, tangents,
            self.threads,
        )  # fmt: skip
        values = profile_values(
            mesh.width, puts.rate, puts.dividend, puts.spread, mesh.nodes, mesh.halvings, profiles, frame,
            boundary, row, self.puts.x[rows],
        )  # fmt: skip
        return _Marched(values, boundary[row], settled[row], self.puts.x[rows] <= boundary[row])


class _Mesh:
    """Steps, widest cell, and for each row its free labels and halvings."""

    def __init__(self, decay: Vector, distance: Vector, steps: int) -> None:
        self.steps = steps
        self.width = float(WIDTH / np.sqrt(steps))
        self.halvings = _halvings(decay, self.width)
        cells = distance * 2.0**self.halvings / self.width
        layers = (LAYERS / decay + 1.0) * 2.0**self.halvings / self.width
        cells = np.where(self.halvings > 0, np.minimum(cells, layers), cells)
        self.nodes = (np.ceil(cells / NODES_STEP) * NODES_STEP).astype(np.int64)


def _halvings(decay: Vector, width: float) -> NDArray[np.int64]:
    """Return how often the widest cells are halved to resolve the stationary premium."""
    wanted = np.log2(np.maximum(width / LAYER * decay, 1.0))
    return np.ceil(wanted).astype(np.int64)


def _distance(puts: Puts, tolerance: Vector, decay: Vector) -> Vector:
    """Return how far, in xi, the free labels reach: from the boundary to where the premium is negligible.

    The premium at xi is at most about r T N(-xi); it is cut off beyond e^{-reach**2/2} = tolerance/(10 r T).
    The boundary is guessed, rather too low, from its expansion at expiry and that of the option without expiry.
    """
    reach = np.sqrt(2.0 * np.log(np.maximum(10.0 * puts.rate / tolerance, 100.0)))
    yields = puts.dividend > 0.0
    early = np.log(np.where(yields, puts.rate / np.where(yields, puts.dividend, 1.0), 1.0))
    start = np.minimum(early, 0.0) / puts.spread
    held = np.maximum(puts.rate - puts.dividend, 0.0) / puts.spread + np.maximum(puts.dividend, 0.0)
    falling = -np.sqrt(2.0 * np.log1p(0.5 / np.maximum(held, 1e-300)))
    perpetual = -np.log1p(puts.spread / decay) / puts.spread
    lowest = np.maximum(np.minimum(falling, start - 1.0), perpetual)
    return reach + np.maximum(start - lowest - puts.drift(), 0.0)
