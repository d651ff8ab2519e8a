"""Which meshes a put is marched on: few classes, that puts of one class march side by side."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Vector

STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)  # by level; two levels up they double
COARSEST, COARSEST_CHECKED = 2, 4  # the first levels with two marches, and with three
WIDTH = 0.75  # dx sqrt(M) of the last steps: wider, and the compact scheme loses the signs of an M-matrix
LAYER = 0.7  # dx at most this share of the length over which the premium decays
LAYERS = 20.0  # of those lengths in the grid
EXTRA_NODES = 6  # beyond the width that grows like sqrt(t)
TYPICAL_ERROR = 7e-6  # of the march with 16 steps at r T = 1: four puts in five are better
TYPICAL_POWER = 0.7  # with which it grows with r T
LOOSE_TOLERANCE = 1e-4  # from which on two marches are enough
STEPS_POWER = 1.0 / np.log2(6.0)  # six times less error for twice the steps
LARGEST_GROWTH, LARGEST_SPREAD, SMALLEST_SPREAD = 8.0, 16.0, 1e-7
SMALLEST_RATE = 1e-9
LARGEST_DISTANCE = 40.0  # in xi, from the boundary to the end of the grid
LARGEST_DECAY_CLASS = 18
ROUNDING = 1e-12  # of the limits, which are still served


@dataclass(frozen=True, slots=True)
class Mesh:
    """M steps equally long in sqrt(t), and labels whose distance is halved each time sqrt(t) is, towards expiry.

    Parameters
    ----------
    steps : int
        M.
    width : float
        The distance of the labels now, where `halvings` is 0.
    nodes : int
        Labels that are free now; the premium is zero beyond.
    halvings : int
        The distance never exceeds width / 2**halvings.
    """

    steps: int
    width: float
    nodes: int
    halvings: int

    def spacing(self, step: int) -> float:
        """Return dx at sqrt(t) = step/steps."""
        return self.width / (1 << self._exponent(step))

    def active(self, step: int) -> int:
        """Return how many labels are free at this step: the width of the premium grows like sqrt(t)."""
        reach = self.nodes * step << (self._exponent(step) - self.halvings)
        return min(self.nodes, reach // self.steps + EXTRA_NODES)

    def _exponent(self, step: int) -> int:
        return max((self.steps // step).bit_length() - 1, self.halvings)


@dataclass(frozen=True, slots=True, eq=False)
class Classes:
    """What decides the meshes of each put; every field has shape (n,).

    Parameters
    ----------
    distance : int array
        The width of the grid, in units of WIDTH.
    decay : int array
        How fast the premium decays, in quarters of an octave.
    level : int array
        Of the first march with M steps.
    served : bool array
        False where the march does not serve; the other fields mean nothing there.
    """

    distance: NDArray[np.int64]
    decay: NDArray[np.int64]
    level: NDArray[np.int64]
    served: BoolVector


def mesh_of(distance: int, decay: int, level: int) -> Mesh:
    """Return the mesh of a class at a level."""
    steps, halvings = STEPS[level], 0
    while 1 << (decay + 2) > steps**2 << (4 * halvings):  # WIDTH / (2**h sqrt(M)) > LAYER / decay
        halvings += 1
    root = float(np.sqrt(steps))
    cells = distance * root * (1 << halvings)
    if halvings > 0:
        slowest = LAYER / WIDTH * 2.0 ** (0.25 * (decay + 1))
        cells = min(cells, (LAYERS / slowest + 1.0) / WIDTH * root * (1 << halvings))
    return Mesh(steps, WIDTH / root, int(np.ceil(cells)), halvings)


def classify(rate: Vector, dividend: Vector, spread: Vector, tolerance: Vector) -> Classes:
    """Return the classes of puts with these r T, q T and sigma sqrt(T), for tolerances of V/K."""
    with np.errstate(all="ignore"):
        drift = (rate - dividend) / spread - 0.5 * spread
        decay = drift + np.sqrt(drift * drift + 2.0 * rate)
        decay_class = 4.0 * np.log2(WIDTH / LAYER * decay) - 2.0
        distance = _distance(rate, dividend, spread, tolerance, drift, decay) / WIDTH
        typical = TYPICAL_ERROR * np.minimum(rate, 1.0) ** TYPICAL_POWER
        steps = 16.0 * (typical / tolerance) ** STEPS_POWER
        level = np.searchsorted(STEPS, np.where(np.isfinite(steps), steps, 0.0))
        fewest = np.where(tolerance >= LOOSE_TOLERANCE, COARSEST, COARSEST_CHECKED)
        served = (
            (rate > SMALLEST_RATE * (1.0 - ROUNDING))
            & (rate < LARGEST_GROWTH * (1.0 + ROUNDING))
            & (np.abs(dividend) < LARGEST_GROWTH * (1.0 + ROUNDING))
            & (spread > SMALLEST_SPREAD * (1.0 - ROUNDING))
            & (spread < LARGEST_SPREAD * (1.0 + ROUNDING))
            & (distance < LARGEST_DISTANCE / WIDTH)
            & (decay_class < LARGEST_DECAY_CLASS)
        )
        return Classes(
            np.where(served, np.ceil(distance), 0.0).astype(np.int64),
            np.where(served, np.ceil(np.maximum(decay_class, 0.0)), 0.0).astype(np.int64),
            np.clip(level, fewest, len(STEPS) - 1).astype(np.int64),
            served,
        )


def _distance(
    rate: Vector, dividend: Vector, spread: Vector, tolerance: Vector, drift: Vector, decay: Vector
) -> Vector:
    """Return how far, in xi, the free labels reach: from the boundary to where the premium is negligible.

    The premium at xi is at most about r T N(-xi); it is cut off beyond e^{-reach**2/2} = tolerance/(10 r T).
    The boundary is guessed, rather too low, from its expansion at expiry and that of the option without expiry.
    """
    reach = np.sqrt(2.0 * np.log(np.maximum(10.0 * rate / tolerance, 100.0)))
    start = np.minimum(np.log(np.where(dividend > 0.0, rate / dividend, 1.0)), 0.0) / spread
    held = np.maximum(rate - dividend, 0.0) / spread + np.maximum(dividend, 0.0)
    falling = -np.sqrt(2.0 * np.log1p(0.5 / np.maximum(held, 1e-300)))
    perpetual = -np.log1p(spread / decay) / spread
    lowest = np.maximum(np.minimum(falling, start - 1.0), perpetual)
    return np.asarray(reach + np.maximum(start - lowest - drift, 0.0))
