"""Grids in s = S/K for options with events, and the Black-Scholes operator on them.

In s a cash dividend is a shift, s = 0 is a node where it may be reached, and central differences are exact for a + b s,
the value deep in the money. Nodes are equally spaced in ln(s + shift), or in that stretched around the strike: like
ln s for s >> shift, like s below.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.flat.grid import Domain, Grid, make_grid
from pricing_core.american.flat.operators import BlackScholesOperator, difference_operators

LEAST_SPREAD = 1e-4  # standard deviations of ln S: a grid needs some width
FURTHEST = 100.0  # of ln(S/K) from the strike
REACHES_ZERO = 0.5  # share of the lowest spot that dividends may take before the grid goes down to 0
LEAST_KEPT = 1e-3  # of the spot, after a proportional dividend: below that the grid goes down to 0
SHIFT = 0.5  # of the lowest spot without dividends, where the grid goes down to 0
SMALLEST = 1e-7  # of the strike: what the spot may still gain below that is nothing
STRETCHED_FROM = 0.5  # standard deviations of ln S over the option's life


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
    """

    low: float
    high: float
    shift: float
    spread: float

    def down_to_zero(self) -> "SpotRange":
        """Return the range with everything below it."""
        return self if self.low == 0.0 else replace(self, low=0.0, shift=SHIFT * self.low)

    def grid(self, intervals: int, stretching: float) -> Grid:
        """Return a grid of this range, the strike's place among the nodes left to chance."""
        one = 1.0 + self.shift
        left, right = (math.log((edge + self.shift) / one) for edge in (self.low, self.high))
        uniform = make_grid(Domain(left, right, False, False, 0.0), intervals, stretching)
        nodes = one * np.exp(uniform.nodes) - self.shift
        nodes[[0, -1]] = self.low, self.high
        return Grid(nodes)


def spot_range(schedule: Schedule, truncation: float, start: tuple[float, float]) -> SpotRange:
    """Return the range that a spot from start[0] to start[1], in units of the strike, reaches.

    ln S stays within sqrt(2 ln(20/truncation)) standard deviations of every path of its mean, under the pricing
    measure and under that of the stock (a call weighs its payoff by S): what happens outside changes the value by
    less than about `truncation` of the strike.
    """
    variance = math.fsum(segment.volatility**2 * segment.duration for segment in schedule.segments)
    spread = max(math.sqrt(variance), LEAST_SPREAD)
    width = math.sqrt(2.0 * math.log(20.0 / truncation)) * spread
    falls = rises = 0.0
    for segment in schedule.segments:
        drift = (segment.rate - segment.dividend_yield) * segment.duration
        half = 0.5 * segment.volatility**2 * segment.duration
        kept = 1.0 - segment.fraction
        falls += min(drift - half, 0.0) + (math.log(kept) if kept >= LEAST_KEPT else 0.0)
        rises += max(drift + half, 0.0)
    undivided = _moved(start[0], falls - width)
    high = _moved(start[1], rises + width)
    paid = math.fsum(segment.amount for segment in schedule.segments) / schedule.strike
    low = undivided - paid
    nothing_left = any(1.0 - segment.fraction < LEAST_KEPT for segment in schedule.segments)
    if low > max((1.0 - REACHES_ZERO) * undivided, SMALLEST * start[0]) and not nothing_left:
        return SpotRange(low, high, 0.0, spread)
    return SpotRange(0.0, high, SHIFT * max(undivided, SMALLEST * start[0]), spread)


def _moved(s: float, distance: float) -> float:
    return math.exp(min(max(math.log(s) + distance, -FURTHEST), FURTHEST))


def natural_stretching(spread: float) -> float:
    """Return the stretching that keeps the payoff's scale, 1 in ln(S/K), resolved on a wide grid."""
    return math.log1p(spread / STRETCHED_FROM) if spread > STRETCHED_FROM else 0.0


def spot_operator(grid: Grid, segment: Segment, watched: tuple[float, ...]) -> BlackScholesOperator:
    """Discretise L = sigma**2 s**2/2 d2/ds2 + (r - q) s d/ds - r by central differences.

    Where a cell is too coarse for the drift, |r - q| ds > sigma**2 s, the diffusion is raised as in
    `black_scholes_operator` (Il'in 1969); `fitted` says whether that happened near one of the watched s.
    """
    s = grid.interior
    first, second, identity = difference_operators(grid)
    width = np.maximum(np.diff(grid.nodes)[:-1], np.diff(grid.nodes)[1:])
    diffusion = 0.5 * segment.volatility**2 * s**2
    drift = (segment.rate - segment.dividend_yield) * s
    half = 0.5 * np.abs(drift) * width
    coarse = half > diffusion
    fitting = np.tanh(np.divide(half, diffusion, out=np.full(s.size, math.inf), where=diffusion > 0.0))
    raised = np.where(coarse, (1.0 + 1e-12) * half / np.where(coarse, fitting, 1.0), diffusion)
    operator = second.scaled(raised).combine(1.0, first.scaled(drift), 1.0)
    return BlackScholesOperator(
        operator.combine(1.0, identity, -segment.rate),
        by_volatility=second.scaled(segment.volatility * s**2),
        by_rate=first.scaled(s).combine(1.0, identity, -1.0),
        by_yield=first.scaled(-s),
        fitted=any(bool(coarse[int(np.argmin(np.abs(s - place)))]) for place in watched),
    )
