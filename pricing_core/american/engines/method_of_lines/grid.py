"""Grids in s = S/K, and the range of spots that they must cover.

In s a cash dividend is a shift, s = 0 is a node where it may be reached, and central differences are exact for a + b s,
the value deep in the money. Nodes are equally spaced in ln(s + shift), or in that stretched around the strike: like
ln s for s >> shift, like s below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.resolution import LARGEST_STRETCHING
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError

SMALLEST_SPREAD = 1e-4  # Smallest standard deviation of ln S that a grid is made for; chosen.
PLACES = 1001  # Number of places at which a local volatility is looked at for how far the spot moves; chosen.
FURTHEST = 100.0  # Largest |ln(S/K)| of a node; chosen far inside the range of floating-point numbers.
REACHES_ZERO = 0.5  # Share of the lowest spot that dividends take from which the grid goes down to 0; chosen.
# Smallest share of the spot left by proportional dividends above which it does not; chosen.
SMALLEST_KEPT = 1e-3
# Shift of a grid that goes down to 0, as a share of the lowest spot without dividends; calibrated.
SHIFT = 0.5
SMALLEST_SPOT = 1e-7  # Smallest spot, in strikes, from which it still matters what the spot may gain; chosen.
LEAST_STRETCHING = 4.5  # Stretching of a narrow grid for a price; calibrated.
# Standard deviation of ln S at expiry from which a grid for boundaries is stretched; calibrated.
STRETCHED_FROM = 0.5
FEWEST_CELLS = 32  # Smallest number of cells of which a grid is a refinement by halves; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Nodes x_0 < x_1 < ... < x_{N+1}: boundary values at the two ends, N unknowns between."""

    nodes: Vector  # (N + 2,)

    def __post_init__(self) -> None:
        if self.nodes.size < 3 or not (self.nodes[1:] > self.nodes[:-1]).all():
            raise InvalidInputError("nodes", self.nodes, "at least 3 increasing numbers")

    @property
    def interior(self) -> Vector:
        """The unknowns' nodes, shape (N,)."""
        return self.nodes[1:-1]


@dataclass(frozen=True, slots=True)
class SpotRange:
    """What the spot may reach from now to expiry but for a negligible chance, in units of the strike.

    Parameters
    ----------
    low, high : float
        0 <= low < high.
    shift : float
        See the module; 0 unless low is 0.
    spread : float
        Standard deviation of ln S at expiry.
    tails : float
        How many times as far the spot moves as with the volatility near the strike everywhere.
    """

    low: float
    high: float
    shift: float
    spread: float
    tails: float = 1.0

    def down_to_zero(self) -> SpotRange:
        """Return the range with everything below it."""
        return self if self.low == 0.0 else replace(self, low=0.0, shift=SHIFT * self.low)

    def grid(self, intervals: int, stretching: float) -> Grid:
        """Return a grid of this range, the strike anywhere between its nodes."""
        left, right = (math.log((edge + self.shift) / (1.0 + self.shift)) for edge in (self.low, self.high))
        shift = self.shift
        if self.low == 0.0 and stretching > 0.0:
            # The left end gives way, and the shift is what makes 0 the first node again, which is less.
            x = _stretched(left, max(right, math.log(self.high)), intervals, stretching)
            shift = 1.0 / math.expm1(-x[0])
        else:
            x = _stretched(left, right, intervals, stretching)
        nodes = (1.0 + shift) * np.exp(x) - shift
        if stretching == 0.0:
            nodes[[0, -1]] = self.low, self.high
        if self.low == 0.0:
            nodes[0] = 0.0
        return Grid(nodes)


@dataclass(frozen=True, slots=True)
class Reach:
    """How far any spot may move from now to expiry but for a negligible chance.

    Parameters
    ----------
    falls, rises : float
        Distances in ln S: at most 0, at least 0.
    paid : float
        Cash dividends, in units of the strike.
    nothing_left : bool
        A proportional dividend takes next to everything.
    spread, tails : float
        As in `SpotRange`.
    """

    falls: float
    rises: float
    paid: float
    nothing_left: bool
    spread: float
    tails: float = 1.0

    def range_of(self, lowest: float, highest: float) -> SpotRange:
        """Return the range that spots between these two, in units of the strike, reach."""
        undivided = _moved(lowest, self.falls)
        high, low = _moved(highest, self.rises), undivided - self.paid
        least = max((1.0 - REACHES_ZERO) * undivided, SMALLEST_SPOT * lowest)
        if low > least and not self.nothing_left:
            return SpotRange(low, high, 0.0, self.spread, self.tails)
        return SpotRange(0.0, high, SHIFT * max(undivided, SMALLEST_SPOT * lowest), self.spread, self.tails)


def reach(schedule: Schedule, truncation: float, spots: tuple[float, ...] = ()) -> Reach:
    """Return how far the spot moves from the strike, and from its own place or from these, in units of the strike.

    ln S stays within sqrt(2 ln(20/truncation)) standard deviations of every path of its mean, under the pricing
    measure and under that of the stock (the payoff of a call grows like S): what happens outside changes the value by
    less than about `truncation` of the strike.
    """
    variance = math.fsum(segment.volatility**2 * segment.duration for segment in schedule.segments)
    spread = max(math.sqrt(variance), SMALLEST_SPREAD)
    deviations = math.sqrt(2.0 * math.log(20.0 / truncation))
    down = up = width = deviations * spread
    if schedule.local is not None:
        starts = [schedule.strike * s for s in spots] if spots else [schedule.spot]
        down, up = _local_widths(schedule, deviations, [*starts, schedule.strike])
    falls = rises = 0.0
    smallest_kept = 1.0
    for segment in schedule.segments:
        drift = (segment.rate - segment.dividend_yield) * segment.duration
        half = 0.5 * segment.volatility**2 * segment.duration
        kept = 1.0 - segment.fraction
        smallest_kept = min(smallest_kept, kept)
        falls += min(drift - half, 0.0) + (math.log(kept) if kept >= SMALLEST_KEPT else 0.0)
        rises += max(drift + half, 0.0)
    paid = math.fsum(segment.amount for segment in schedule.segments) / schedule.strike
    tails = max(down, up) / width
    return Reach(falls - down, rises + up, paid, smallest_kept < SMALLEST_KEPT, spread, max(tails, 1.0))


def _local_widths(schedule: Schedule, deviations: float, starts: list[float]) -> tuple[float, float]:
    """Return how far ln S moves down and up from some places, from the one where it is most.

    So many standard deviations are where the integral of d ln S / sigma is as many roots of the expiry (Varadhan 1967),
    sigma the root mean square over time.
    """
    assert schedule.local is not None
    surface, segments = schedule.local.volatility, schedule.segments
    shift = segments[0].volatility - schedule.local.reference
    logarithms, mean = np.log(surface.spots), np.sqrt(surface.mean_variance(0.0, segments[-1].end))
    slowness = 1.0 / np.maximum(mean + shift, SMALLEST_SPREAD)
    distances = FURTHEST * np.linspace(0.0, 1.0, PLACES) ** 2
    enough = deviations * math.sqrt(segments[-1].end)
    widths = []
    for side in (-1.0, 1.0):
        for start in starts:
            slow = np.interp(math.log(start) + side * distances, logarithms, slowness)
            steps = 0.5 * (slow[1:] + slow[:-1]) * np.diff(distances)
            passed = np.concatenate([[0.0], np.cumsum(steps)])
            widths.append(float(np.interp(enough, passed, distances)))
    return max(widths[: len(starts)]), max(widths[len(starts) :])


def _moved(s: float, distance: float) -> float:
    return math.exp(min(max(math.log(s) + distance, -FURTHEST), FURTHEST))


def natural_stretching(spread: float, tails: float = 1.0) -> float:
    """Return the stretching with which a price has its smallest error, which the payoff's kink makes."""
    return min(LEAST_STRETCHING + math.log1p(spread) + math.log(tails), LARGEST_STRETCHING)


def even_stretching(spread: float) -> float:
    """Return the stretching that keeps the payoff's scale, 1 in ln(S/K), resolved: for boundaries."""
    return math.log1p(spread / STRETCHED_FROM) if spread > STRETCHED_FROM else 0.0


def _stretched(left: float, right: float, intervals: int, stretching: float) -> Vector:
    """Return intervals + 1 increasing numbers from left to right, or a little further.

    At stretching 0 they are equally spaced, as in (11.60)-(11.61). At s > 0 they are c + d sinh(s u), u equally spaced:
    about exp(s)/s times closer around 0, the strike, than at the far end. The strike is one of them, to which an end
    gives way, and those for twice as many intervals contain them, so that the error of a value falls regularly.
    """
    if stretching == 0.0:
        return np.linspace(left, right, intervals + 1)
    center = min(max(0.0, left), right)
    scale = max(center - left, right - center) / math.sinh(stretching)
    low, high = math.asinh((left - center) / scale), math.asinh((right - center) / scale)
    base = intervals
    while base % 2 == 0 and base >= 2 * FEWEST_CELLS:
        base //= 2
    fair = math.floor(base * -low / (high - low))
    fewest, most = (1, base - 1) if left < center < right else (fair, fair)  # 0, or all
    shares = [min(max(cells, fewest), most) for cells in (fair, fair + 1)]
    # The coarser side gives the width of the cells: the other one goes a little further than asked.
    coarser = [max(-low / max(cells, 1), high / max(base - cells, 1)) for cells in shares]
    width = min(coarser) * base / intervals
    below = shares[coarser.index(min(coarser))]
    first = -below * (intervals // base)
    nodes: Vector = center + scale * np.sinh(width * np.arange(first, first + intervals + 1))
    return nodes
