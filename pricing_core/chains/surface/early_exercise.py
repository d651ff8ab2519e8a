"""Early exercise premiums of all strikes of an expiry under one local volatility, from one march.

The local volatility is the same for all strikes, so on one grid in ln S they share the matrix of every step, and a step
for all of them is one elimination with many right sides (`march_strikes` of the kernel), in which Brennan and
Schwartz's (1977) substitution solves the linear complementarity problem exactly. The premium is the American less the
European value of the same march, in which most of the error of the grid cancels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse

from pricing_core import kernel
from pricing_core.american.contracts.curves import integral
from pricing_core.american.contracts.local_volatility import LocalVolatility, hat_weights
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.chains.surface.coordinates import Coordinates

REACH = 5.5  # How far the grid reaches from the spot, in standard deviations; chosen.
FEWEST = 8  # Smallest number of steps between two events; chosen.
HALF, STEPS = 200, 80  # Nodes on each side of the spot, and steps to an expiry without events; chosen.
TINY = 1e-25  # Added to all values, in spots: far from the strike they would leave the normal floating-point numbers.


@dataclass(frozen=True, slots=True)
class Exercise:
    """What the early exercise of options of one type and expiry is worth at the spot.

    Parameters
    ----------
    premium : Vector, shape (n,)
        American less European price, money.
    exercised : BoolVector, shape (n,)
        Whether exercise is optimal now.
    """

    premium: Vector
    exercised: BoolVector


def early_exercise(
    local_volatility: LocalVolatility,
    market: Market,
    coordinates: Coordinates,
    option_type: str,
    strike: Vector,
    expiry: float,
    spread: float,
) -> Exercise:
    """Return the early exercise premiums of options of one type and expiry, to about 5e-6 of the spot.

    They are extrapolated from two grids, one twice as fine as the other: both errors are of second order.

    Where exercise is optimal between two spots, as under negative rates, the inner boundary is found by projection, to
    first order in the step.

    Parameters
    ----------
    strike : Vector, shape (n,)
    spread : float
        Standard deviation of the logarithm of the spot at expiry, for the width of the grid.
    """
    given = (local_volatility, market, coordinates, option_type, strike, expiry, spread)
    fine, coarse = (_March.of(*given, HALF // part, STEPS // part).exercise() for part in (1, 2))
    premium = fine.premium + (fine.premium - coarse.premium) / 3.0
    return Exercise(np.maximum(premium, 0.0), fine.exercised)


@dataclass(frozen=True, slots=True)
class _March:
    """Nodes from the exercise region outward, the payoff at them, and the market along the steps.

    Parameters
    ----------
    spots : Vector, shape (N,)
        Spots from the side of the exercise region on: increasing for puts, decreasing for calls.
    strike : Vector, shape (n,)
    obstacle : Matrix, shape (N, n)
        The payoff at the nodes.
    half, steps : int
        Number of nodes on each side of the spot, and of steps to an expiry without events; between events in proportion
        to the root of the time, at least `FEWEST`.
    variances : Matrix, shape (M, N)
        Squared local volatility at its own times.
    """

    market: Market
    coordinates: Coordinates
    local_volatility: LocalVolatility
    expiry: float
    half: int
    steps: int
    spots: Vector
    width: float
    sign: float
    strike: Vector
    obstacle: Matrix
    variances: Matrix

    @classmethod
    def of(
        cls,
        local_volatility: LocalVolatility,
        market: Market,
        coordinates: Coordinates,
        option_type: str,
        strike: Vector,
        expiry: float,
        spread: float,
        half: int,
        steps: int,
    ) -> _March:
        """Return the march of options of one type and expiry."""
        sign = 1.0 if option_type == "put" else -1.0
        drift = abs(math.log(coordinates.forward(expiry) / market.spot))
        width = (REACH * spread + drift) / half
        spots = market.spot * np.exp(sign * width * np.arange(-half, half + 1))
        obstacle = np.maximum(sign * (strike - spots[:, None]), 0.0)
        variances = local_volatility.at_nodes_of_time(spots) ** 2
        return cls(
            market,
            coordinates,
            local_volatility,
            expiry,
            half,
            steps,
            spots,
            width,
            sign,
            strike,
            obstacle,
            variances,
        )

    def exercise(self) -> Exercise:
        """Return what early exercise is worth at the spot."""
        american, european = (values[self.half] for values in self.values())
        payoff = self.obstacle[self.half]
        return Exercise(american - european, (american <= payoff) & (payoff > 0.0))

    def values(self) -> tuple[Matrix, Matrix]:
        """Return the American and the European values now, each of shape (N, n)."""
        events = self._events()
        times = [self.expiry, *sorted((t for t in events if t < self.expiry), reverse=True), 0.0]
        both = np.tile(self._payoff(*events.get(self.expiry, (1.0, 0.0))), (1, 2)) + TINY * self.market.spot
        if self.expiry in events:
            both[:, : self.strike.size] = np.maximum(both[:, : self.strike.size], self.obstacle)
        for late, early in pairwise(times):
            both = self._marched(both, late, early)
            if early in events and early > 0.0:
                both = self._before(both, *events[early])
        return both[:, : self.strike.size], both[:, self.strike.size :]

    def _events(self) -> dict[float, tuple[float, float]]:
        """Return the fraction kept and the amount paid at each ex-time up to expiry."""
        found: dict[float, tuple[float, float]] = {}
        for paid in self.market.proportional_dividends:
            if 0.0 < paid.time <= self.expiry:
                kept, amount = found.get(paid.time, (1.0, 0.0))
                found[paid.time] = (kept * (1.0 - paid.fraction), amount)
        for cash in self.market.cash_dividends:
            if 0.0 < cash.time <= self.expiry:
                kept, amount = found.get(cash.time, (1.0, 0.0))
                found[cash.time] = (kept, amount + cash.amount)
        return found

    def _after(self, kept: float, amount: float) -> Vector:
        """Return the spots just after a dividend."""
        return np.maximum(kept * self.spots - amount, 1e-12 * self.spots)

    def _payoff(self, kept: float, amount: float) -> Matrix:
        """Return the means of the payoffs over the cells of the nodes, after a dividend, shape (N, n)."""
        spots = self._after(kept, amount)[:, None]
        low, high = (np.log(spots) + half * self.width for half in (-0.5, 0.5))
        edge = np.clip(np.log(self.strike), low, high)
        start, end = (low, edge) if self.sign > 0.0 else (edge, high)
        means = self.sign * (self.strike * (end - start) - (np.exp(end) - np.exp(start))) / self.width
        return np.asarray(np.maximum(means, self.sign * (self.strike - spots)))

    def _before(self, both: Matrix, kept: float, amount: float) -> Matrix:
        """Return the values just before an ex-time: those after it at the spot less the dividend, or the payoff."""
        weights = _interpolation(self.spots, self._after(kept, amount), self.width * self.sign)
        moved, count = np.asarray(weights @ both), self.strike.size
        moved[:, :count] = np.maximum(moved[:, :count], self.obstacle)
        return moved

    def _marched(self, both: Matrix, late: float, early: float) -> Matrix:
        """Return the values at an earlier time, no event between, by BDF2 with steps that are finer at both ends."""
        steps = max(FEWEST, math.ceil(self.steps * math.sqrt((late - early) / self.expiry)))
        times = late - (late - early) * np.sin(0.5 * np.pi * np.arange(steps + 1) / steps) ** 2
        variances = hat_weights(self.local_volatility.times, times[1:]) @ self.variances
        factors, matrices, h_before = [], [], math.inf
        for variance, (end, start) in zip(variances, pairwise(times.tolist()), strict=True):
            ratio = (end - start) / h_before
            now = (1.0 + 2.0 * ratio) / (1.0 + ratio)
            factors.append((1.0 + ratio, ratio**2 / (1.0 + ratio)))
            matrices.append(self._matrix(variance, now, start, end))
            h_before = end - start
        return np.asarray(kernel.march_strikes(np.array(factors), np.array(matrices), both, self.obstacle))

    def _matrix(self, variance: Vector, now: float, start: float, end: float) -> Matrix:
        """Return now I - h L as its lower, middle and upper diagonal, shape (3, N).

        L v = sigma^2 (v_xx - v_x)/2 + (r - q) v_x - r v; straight in S at both ends.
        """
        rate = integral(self.market.rate, end) - integral(self.market.rate, start)
        held = self.coordinates.yield_integral(end) - self.coordinates.yield_integral(start)
        half = 0.5 * (end - start) * variance
        slope = (rate - held - half) / (2.0 * self.width) * self.sign
        # Where the drift would make an off-diagonal negative the diffusion is raised to it.
        second = np.maximum(half / self.width**2, np.abs(slope))
        lower, upper = second - slope, second + slope
        ends = self.sign * (rate - held) / self.width
        lower[0], upper[0], lower[-1], upper[-1] = 0.0, ends, -ends, 0.0
        return np.array([-lower, now + rate + lower + upper, -upper])


def _interpolation(spots: Vector, places: Vector, step: float) -> sparse.csr_matrix:
    """Return the interpolation at places, cubic in ln S, straight in S beyond the grid, shape (N, N)."""
    position = (np.log(places) - math.log(spots[0])) / step
    base = np.clip(np.floor(position).astype(np.intp) - 1, 0, spots.size - 4)
    t = position - base
    weights = np.stack(
        [np.prod([(t - k) / (j - k) for k in range(4) if k != j], axis=0) for j in range(4)], axis=1
    )
    for beyond, first in ((position < 0.0, 0), (position > spots.size - 1.0, 2)):
        near, far = spots[base[beyond] + first], spots[base[beyond] + first + 1]
        share = (places[beyond] - near) / (far - near)
        weights[beyond] = 0.0
        weights[beyond, first], weights[beyond, first + 1] = 1.0 - share, share
    rows = np.repeat(np.arange(places.size), 4)
    columns = (base[:, None] + np.arange(4)).ravel()
    return sparse.csr_matrix((weights.ravel(), (rows, columns)), shape=(places.size, spots.size))
