"""Exercise by simulated spots that meet the boundary between the steps with a Brownian bridge's probability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american import Market, Option, exercise_boundary
from pricing_core.american.book.book import Book
from pricing_core.arrays import Vector

JUST_AFTER = 1e-9


@dataclass(frozen=True)
class Simulated:
    """Shares of the paths, and the times of early exercise."""

    times: Vector  # of early exercise, inf where there is none
    at_expiry: float
    worthless: float

    @property
    def probability(self) -> float:
        return float(np.isfinite(self.times).mean())

    def cumulative(self, time: float) -> float:
        return float((self.times <= time).mean())


def simulate(option: Option, market: Market, paths: int, steps: int, seed: int) -> Simulated:
    """Return when each of the paths is exercised; antithetic.

    Who meets the boundary in a step does so at any time of it, equally likely.
    """
    random, within = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    book = Book.of([(option, market)])
    segments, local = book.segments_of(), book.local_terms()
    place = np.full(paths, math.log(book.diffusing().item()))
    when = np.full(paths, math.inf)
    alive = np.ones(paths, dtype=bool)
    american = option.exercise == "american"
    for segment in segments:
        last = segment is segments[-1]
        share = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, steps + 1)) ** 2
        times = np.minimum(segment.start + segment.duration * share, segment.end)
        asked = times.copy()
        if segment.start > 0.0:
            asked[0] += JUST_AFTER * segment.duration
        if segment.exercisable and american:
            low, high = _ends(option, market, segment, asked)
        else:
            low, high = np.full(steps + 1, math.nan), np.full(steps + 1, math.nan)
        _take(place, when, alive, low[0], high[0], segment.start)
        for i in range(steps):
            dt = times[i + 1] - times[i]
            if dt <= 0.0:
                continue
            half = random.standard_normal(paths // 2)
            before, volatility = place, _volatility(local, segment, 0.5 * (times[i] + times[i + 1]), place)
            drift = segment.rate - segment.dividend_yield - 0.5 * volatility**2
            place = before + drift * dt + volatility * math.sqrt(dt) * np.concatenate([half, -half])
            chance = random.random(paths)
            for start, end, side in ((high[i], high[i + 1], 1.0), (low[i], low[i + 1], -1.0)):
                if not (math.isfinite(start) and math.isfinite(end)):
                    continue
                gap, later = side * (before - start), side * (place - end)
                outside = alive & (gap >= 0.0)
                bridge = np.exp(-2.0 * np.maximum(gap, 0.0) * np.maximum(later, 0.0) / (volatility**2 * dt))
                met = outside & ((later <= 0.0) | (chance < bridge))
                when[met] = times[i] + dt * within.random(int(met.sum()))
                alive &= ~met
        if last:
            break
        if segment.exercise_at_end:
            ends = _ends(option, market, segment, np.array([segment.end]))
            _take(place, when, alive, ends[0][0], ends[1][0], segment.end)
        spot = np.exp(place) * (1.0 - segment.fraction) - segment.amount
        gone = spot <= 0.0
        place = np.log(np.where(gone, 1e-300, spot))
    strike = option.strike - segments[-1].escrow_at(option.expiry)
    gains = alive & ((np.exp(place) < strike) if option.is_put else (np.exp(place) > strike))
    return Simulated(when, float(gains.mean()), float((alive & ~gains).mean()))


def _volatility(local, segment, time: float, place: Vector) -> Vector | float:
    """Return the volatility of every path in a step, that of the place where it begins."""
    if local is None:
        return segment.volatility
    nodes = np.linspace(place.min(), place.max(), 4001)  # a linear interpolant is near enough, and fast
    return np.interp(place, nodes, local.volatility.at(time, np.exp(nodes)))


def _take(place: Vector, when: Vector, alive: Vector, low: float, high: float, time: float) -> None:
    """Exercise who stands between two ends, NaN for none; both NaN: nobody."""
    if math.isnan(low) and math.isnan(high):
        return
    inside = alive & (place >= (-math.inf if math.isnan(low) else low))
    inside &= place <= (math.inf if math.isnan(high) else high)
    when[inside] = time
    alive &= ~inside


def _ends(option: Option, market: Market, segment, times: Vector) -> tuple[Vector, Vector]:
    found = exercise_boundary(option, market, times)
    escrow = np.array([segment.escrow_at(time) for time in times.tolist()])
    nothing = np.full(times.size, math.nan)
    far = nothing if found.other_boundary is None else found.other_boundary
    with np.errstate(invalid="ignore", divide="ignore"):
        near, far = (np.where(end > escrow, np.log(end - escrow), math.nan) for end in (found.boundary, far))
    return (far, near) if option.is_put else (near, far)
