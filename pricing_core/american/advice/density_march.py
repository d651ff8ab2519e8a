"""The march of the density of a holder's spot on a grid, absorbed where exercise is optimal: for local volatilities.

The masses p at the nodes follow p' = A^T p, A being the generator of the spot on the grid, whose rows add up to zero:
mass is lost in the exercise region alone. The row next to the region has its end, where everyone exercises, in the
place of a node (Shortley and Weller 1938), so that the error is of second order in the cells. The steps are dense at
both ends of a span, the variance is averaged over them, and each is one of SDIRK2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pricing_core.american.advice.cell_volatility import CellVolatility
from pricing_core.american.advice.exercise_times import Exercised, exercise_without_spot
from pricing_core.american.advice.region import Region, Span, parameters, times_in
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.arrays import BoolVector, Vector
from pricing_core.stepping import SDIRK2

CELLS_PER_STEP = 8  # Number of cells of the grid for each step of a span; chosen.
SMALLEST_CELL = 1e-6  # Smallest distance of a node to the region, as a share of its cell; chosen.


@dataclass(slots=True, eq=False)
class DensityMarch:
    """The masses of those who have not exercised at the nodes of a grid, from segment to segment.

    Parameters
    ----------
    book : Book
        One contract, with a local volatility.
    count : int
        Number of steps of a span.
    shift : float
        By how many of its errors every end of the region is moved: for the error that the boundary's own error makes.
    check : callable
        Called between the spans; may raise.

    Attributes
    ----------
    nodes : Vector, shape (N + 2,)
        Spots in units of the strike.
    mass : Vector, shape (N + 2,)
        The mass at all nodes that has not been exercised.
    """

    book: Book
    count: int
    shift: float
    check: Callable[[], None]
    found: Exercised = field(default_factory=Exercised)
    nodes: Vector = field(init=False)
    mass: Vector = field(init=False)
    _strike: float = field(init=False)
    _volatility: CellVolatility = field(init=False)
    # What share of the cell around each node lay outside the region at the end of the last span.
    _outside: Vector = field(init=False)

    def __post_init__(self) -> None:
        from pricing_core.american.engines.obstacle_march.contract_problem import (  # noqa: PLC0415  a price does without
            contract_problem,
            place_of,
        )
        from pricing_core.obstacle.interval import choose_map  # noqa: PLC0415

        self._strike, local = self.book.strike.item(), self.book.local_terms()
        assert local is not None
        whole = choose_map(contract_problem(self.book), np.array([place_of(self.book)]))
        self.nodes = np.exp(np.linspace(whole.left, whole.right, CELLS_PER_STEP * self.count + 1))
        self._volatility = CellVolatility.of(local, self._strike * self.nodes)
        self._outside = np.ones(self.nodes.size)
        self.mass = self._split(self.book.diffusing() / self.book.strike, np.ones(1))

    def run(self, spans: list[list[Span]], regions: list[Region | None]) -> Exercised:
        """Return how much of the mass is exercised at each time; arguments as in `ExerciseMarch.run`."""
        segments = self.book.segments_of()
        for k, segment in enumerate(segments):
            for span in spans[k]:
                self.check()
                self.pass_through(segment, span)
            if segment is segments[-1]:
                break
            region = regions[k]
            if region is not None:
                self._cut(segment.end, region)
            self.pay(segment, k + 1)
        self._expire(segments[-1])
        return self.found

    def pass_through(self, segment: Segment, span: Span) -> None:
        """Carry the masses at all nodes through a span."""
        self._outside = np.ones(self.nodes.size)
        if span.exists:
            self._cut(span.start, span.region_at(0.0))
        mesh = parameters(self.count)
        times = times_in(span.start, span.end, mesh)
        weights = self._volatility.weights_of_steps(segment, segment.end - times[::-1])[::-1]
        absorbed = np.zeros(self.count + 1)
        for step in range(self.count):
            middle = 0.5 * (mesh[step] + mesh[step + 1])
            region = span.region_at(middle).moved(self.shift) if span.exists else None
            excess = self._volatility.excess(weights[min(step, len(weights) - 1)])
            absorbed[step + 1] = self._step(segment, times[step + 1] - times[step], excess, region)
        if span.exists:
            # Who stands in the region at the end of the last step has met it before.
            inside = self._share_inside(span.region_at(1.0).moved(self.shift))
            absorbed[-1] += self._taken(inside)
            self._outside = 1.0 - inside
            self.found.flows.append((span.start, span.end, np.cumsum(absorbed)))

    def _step(self, segment: Segment, h: float, excess: Vector, region: Region | None) -> float:
        """Take one step, and return the mass that was absorbed."""
        gone = self._inside(region)
        absorbed = self._taken(gone.astype(np.float64))
        lower, upper = self._generator(segment, excess, region)
        diagonal = -(lower + upper)
        if gone.any():  # what flows into the region is lost
            lower[1:][gone[:-1]] = 0.0
            upper[:-1][gone[1:]] = 0.0
            lower[gone] = upper[gone] = diagonal[gone] = 0.0
        before = float(self.mass.sum())
        (theta,), (rest, _) = SDIRK2.a
        first = _transposed_solve(lower, diagonal, upper, theta * h, self.mass)
        ahead = rest / theta
        base = self.mass + ahead * (first - self.mass)
        self.mass = _transposed_solve(lower, diagonal, upper, theta * h, base)
        return absorbed + (before - float(self.mass.sum()) if gone.any() else 0.0)

    def _generator(self, segment: Segment, excess: Vector, region: Region | None) -> tuple[Vector, Vector]:
        """Return the rates down and up from every node, shape (N + 2,); the two ends are left by nobody."""
        s, lower, upper = self.nodes, np.zeros(excess.size + 2), np.zeros(excess.size + 2)
        left, right = np.diff(s)[:-1], np.diff(s)[1:]
        drift = (segment.rate - segment.dividend_yield) * s[1:-1]
        diffusion = 0.5 * np.maximum(segment.volatility + excess, 0.0) ** 2 * s[1:-1] ** 2
        # Raised where a cell is too coarse for the drift: no rate is negative (Il'in 1969).
        half = 0.5 * np.abs(drift) * np.maximum(left, right)
        coarse = half > diffusion
        share = np.divide(half, diffusion, out=np.full(half.size, math.inf), where=diffusion > 0.0)
        diffusion = np.where(coarse, (1.0 + 1e-12) * half / np.where(coarse, np.tanh(share), 1.0), diffusion)
        lower[1:-1] = (2.0 * diffusion - drift * right) / (left * (left + right))
        upper[1:-1] = (2.0 * diffusion + drift * left) / (right * (left + right))
        if region is None:
            return lower, upper
        carry, strike, twice = segment.rate - segment.dividend_yield, self._strike, 2.0 * diffusion
        for edge, above in ((region.high, True), (region.low, False)):
            if math.isinf(edge):
                continue
            place = math.exp(edge) / strike
            node = int(np.searchsorted(s, place, side="right")) - (0 if above else 1)
            node -= 0 if above or s[node] < place else 1
            if not 1 <= node <= excess.size:
                continue
            cell = left[node - 1] if above else right[node - 1]
            near = max(abs(s[node] - place), SMALLEST_CELL * cell)
            down, up = (near, right[node - 1]) if above else (left[node - 1], near)
            m, a = carry * s[node], twice[node - 1]
            lower[node], upper[node] = (
                max(a - m * up, 0.0) / (down * (down + up)),
                max(a + m * down, 0.0) / (up * (down + up)),
            )
        return lower, upper

    def _inside(self, region: Region | None) -> BoolVector:
        """Tell which nodes lie in a region."""
        s = self.nodes
        if region is None:
            return np.zeros(s.size, dtype=bool)
        strike = self._strike
        low = math.exp(region.low) / strike if region.low > -math.inf else -1.0
        high = math.exp(region.high) / strike if region.high < math.inf else math.inf
        return np.asarray((s >= low) & (s <= high))

    def _taken(self, share: Vector) -> float:
        """Take shares of the mass at the nodes away."""
        mass = float(share @ self.mass)
        self.mass = (1.0 - share) * self.mass
        return mass

    def _cut(self, time: float, region: Region) -> None:
        """Let those in a region exercise."""
        gained = self._taken(self._share_inside(region.moved(self.shift)))
        if gained > 0.0:
            self.found.bursts.append((time, gained))

    def _share_inside(self, region: Region) -> Vector:
        """Return what share of the cell around each node lies in a region."""
        s, strike = self.nodes, self._strike
        edges = np.concatenate([s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]])
        low, high = (
            math.copysign(math.inf, end) if math.isinf(end) else math.exp(end) / strike
            for end in (region.low, region.high)
        )
        inside = np.minimum(edges[1:], high) - np.maximum(edges[:-1], low)
        return np.asarray(np.clip(inside / np.diff(edges), 0.0, 1.0))

    def pay(self, segment: Segment, following: int) -> None:
        """Let the spot drop, s -> max(s (1 - fraction) - amount, 0), before the segment `following`."""
        if segment.fraction <= 0.0 and segment.amount <= 0.0:
            return
        places = self.nodes * (1.0 - segment.fraction) - segment.amount / self._strike
        lost = float(self.mass[places <= 0.0].sum())
        kept = places > 0.0
        self.mass = self._split(places[kept], self.mass[kept])
        if lost > 0.0:
            exercise_without_spot(self.book, self.found, lost, following)

    def _split(self, places: Vector, masses: Vector) -> Vector:
        """Return the masses at places between nodes on these nodes, with the same means."""
        s = self.nodes
        above = np.clip(np.searchsorted(s, places), 1, s.size - 1)
        share = np.clip((places - s[above - 1]) / (s[above] - s[above - 1]), 0.0, 1.0)
        low = np.bincount(above - 1, (1.0 - share) * masses, minlength=s.size)
        return np.asarray(low + np.bincount(above, share * masses, minlength=s.size))

    def _expire(self, last: Segment) -> None:
        """Note who exercises at expiry; the cell of the strike is shared."""
        level = self._strike - last.escrow_at(last.end)
        top = math.log(level) if level > 0.0 else -math.inf
        below = self._share_inside(Region(-math.inf, top, 0.0))
        paying = below if self.book.is_put.item() else 1.0 - below
        outside = np.maximum(self._outside, 1e-300)  # of those there, the others have exercised
        gained = float(self.mass @ np.clip((paying - (1.0 - self._outside)) / outside, 0.0, 1.0))
        left = float(self.mass.sum())
        self.found.at_expiry += gained
        self.found.worthless += left - gained


def _transposed_solve(lower: Vector, diagonal: Vector, upper: Vector, h: float, right: Vector) -> Vector:
    """Solve (1 - h A^T) p = right for the masses p, A with these rows."""
    from scipy.linalg import solve_banded  # noqa: PLC0415  a price does without it

    bands = np.zeros((3, right.size))
    bands[0, 1:], bands[1], bands[2, :-1] = -h * lower[1:], 1.0 - h * diagonal, -h * upper[:-1]
    return np.asarray(solve_banded((1, 1), bands, right, check_finite=False))
