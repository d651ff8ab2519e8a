"""One contract as an obstacle problem over x = ln(S/K), money in strikes.

S is the spot that diffuses: in the escrowed model the quoted one less what the dividends due are worth, A(t). Exercise
then brings 1 - A(t)/K - e^x, or its negative: the obstacle moves, and a dividend changes nothing else.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import LocalTerms, Segment
from pricing_core.arrays import Matrix, Vector
from pricing_core.march_settings import WIDTH
from pricing_core.obstacle import Diffusion, Event, Obstacle, ObstacleProblem
from pricing_core.obstacle.functions import Given

Life: TypeAlias = tuple[Segment, ...]  # the segments of a contract in the order of time

# Smallest volatility of the problem, per sqrt(year), as a share of the largest one: the equation wants one above 0.
# What it adds to a price is of the size of its square.
LEAST_VOLATILITY = 1e-3
GONE = 1e-300  # Spot, in strikes, that stands for one that a dividend has used up: its logarithm is finite.
MOST_BREAKS = 24  # Largest number of a surface's times at which steps end: more of them are nearly smooth.
TABLES = 8  # Number of grids whose local volatilities are remembered.
# Deviations of ln(spot) below a dividend at which the interval ends where the spot may fall so far: the value is linear
# in the spot from there on.
BELOW_DIVIDENDS = 3.0


def place_of(book: Book) -> float:
    """Return x of a book of one contract now."""
    return math.log(book.diffusing().item()) - math.log(book.strike.item())


def contract_problem(book: Book, restarts: Collection[float] = (), *, cut: bool = False) -> ObstacleProblem:
    """Return the problem of a book of one contract, with time to expiry and a spot above 0.

    Contracts whose segments are cut alike have problems whose segments are, so that they may be neighbours
    (`pricing_core.obstacle.direction.Neighbours`).

    Parameters
    ----------
    restarts : collection of float
        Ends of segments at which steps begin anew though nothing may happen: where a cash dividend is 0, but is not in
        a neighbour, and where exercise begins to earn.
    cut : bool
        Whether steps end at the end of every segment, for neighbours whose coefficients jump there.
    """
    segments, local = book.segments_of(), book.local_terms()
    is_put, strike = book.is_put.item(), book.strike.item()
    volatility = _volatility(segments, local, strike)
    carry = _steps([segment.rate - segment.dividend_yield for segment in segments], segments)
    return ObstacleProblem(
        Diffusion(
            volatility,
            _drift(carry, volatility),
            _steps([segment.rate for segment in segments], segments),
            breaks=_breaks(segments, local, cut=cut),
        ),
        _payoff(is_put),
        segments[-1].end,
        lower=_obstacle(segments, strike, is_put=is_put),
        events=[event for segment in segments for event in _events(segment, strike, segment.end in restarts)],
        interval=(_left_end(segments, local, strike, book.diffusing().item() / strike), None),
        ends=("exponential", "linear" if is_put else "exponential"),  # a put tends to 0
    )


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """A number for each segment, as a function of x and t; at a segment's end it has the next one's.

    Parameters
    ----------
    ends : tuple of float
        The ends of all segments but the last.
    numbers : tuple of float
    """

    ends: tuple[float, ...]
    numbers: tuple[float, ...]

    def at(self, t: float) -> float:
        """Return the number at the time t."""
        return self.numbers[bisect_right(self.ends, t)]

    def __call__(self, x: Vector, t: float) -> Vector:
        """Return it at every place."""
        return np.full(x.shape, self.at(t))


def _steps(numbers: list[float], segments: Life) -> float | Steps:
    """Return numbers of segments as a function, or as a number where they are all the same."""
    if len(set(numbers)) == 1:
        return numbers[0]
    return Steps(tuple(segment.end for segment in segments[:-1]), tuple(numbers))


def _at(number: float | Steps, t: float) -> float:
    return number.at(t) if isinstance(number, Steps) else number


def _breaks(segments: Life, local: LocalTerms | None, *, cut: bool) -> list[float]:
    """Return the times at which coefficients jump, and those at which a local volatility is not smooth."""
    found = {a.end for a, b in pairwise(segments) if cut or _changes(a, b)}
    if local is not None:
        inside = [t for t in local.volatility.times.tolist() if 0.0 < t < segments[-1].end]
        found |= set(inside if len(inside) <= MOST_BREAKS else [])
    return sorted(found)


def _changes(before: Segment, after: Segment) -> bool:
    names = ("rate", "dividend_yield", "volatility")
    return any(getattr(before, name) != getattr(after, name) for name in names)


def _volatility(
    segments: Life, local: LocalTerms | None, strike: float
) -> float | Steps | SurfaceInTime | SurfaceNow:
    """Return the volatility as a number or a function, above 0."""
    numbers = [segment.volatility for segment in segments]
    if local is None:
        least = LEAST_VOLATILITY * max(numbers)
        return _steps([max(number, least) for number in numbers], segments)
    shift = _steps([number - local.reference for number in numbers], segments)
    surface = Surface(local, strike, shift)
    return (
        SurfaceNow(surface)
        if local.volatility.is_steady and not isinstance(shift, Steps)
        else SurfaceInTime(surface)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A local volatility over x, and what a bump of the segments' volatilities adds to it.

    Parameters
    ----------
    local : LocalTerms
    strike : float
        Money.
    shift : float or Steps
        Per sqrt(year).
    """

    local: LocalTerms
    strike: float
    shift: float | Steps
    # The variances at the surface's times and at the nodes of grids, and the last values that were asked for.
    _tables: list[tuple[Vector, Matrix]] = field(init=False, default_factory=list)
    _last: list[tuple[Vector, float, Vector]] = field(init=False, default_factory=list)

    def at(self, x: Vector, t: float) -> Vector:
        """Return the volatility at places x, shape (n,), and a time."""
        if self._last and self._last[0][0] is x and self._last[0][1] == t:
            return self._last[0][2]
        surface, table = self.local.volatility, self._table(x)
        times = surface.times
        above = min(max(int(np.searchsorted(times, t)), 1), max(times.size - 1, 1))
        variance: Vector = table[0]
        if times.size > 1:
            share = min(max((t - times[above - 1]) / (times[above] - times[above - 1]), 0.0), 1.0)
            variance = (1.0 - share) * table[above - 1] + share * table[above]
        least = LEAST_VOLATILITY * float(surface.values.max())
        found = np.maximum(np.sqrt(variance) + _at(self.shift, t), least)
        self._last[:] = [(x, t, found)]
        return found

    def _table(self, x: Vector) -> Matrix:
        """Return the variances at the times of the surface and at places x, shape (m, n)."""
        for places, known in self._tables:
            if places is x:
                return known
        table: Matrix = self.local.volatility.at_nodes_of_time(self.strike * np.exp(x)) ** 2
        self._tables.append((x, table))
        del self._tables[:-TABLES]
        return table


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceInTime:
    """A local volatility as a function of x and t."""

    surface: Surface

    def __call__(self, x: Vector, t: float) -> Vector:
        """Return the volatility."""
        return self.surface.at(x, t)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceNow:
    """A local volatility that does not depend on the time."""

    surface: Surface

    def __call__(self, x: Vector) -> Vector:
        """Return the volatility."""
        return self.surface.at(x, 0.0)


def _drift(carry: float | Steps, volatility: Given) -> Given:
    """Return rate - dividend yield - volatility^2/2, the drift of ln S."""
    if isinstance(volatility, SurfaceNow) and not isinstance(carry, Steps):
        return lambda x: carry - 0.5 * volatility(x) ** 2
    if isinstance(volatility, SurfaceNow | SurfaceInTime):
        surface = volatility.surface
        return lambda x, t: _at(carry, t) - 0.5 * surface.at(x, t) ** 2
    assert isinstance(volatility, float | Steps)
    known = carry if isinstance(carry, Steps) else volatility
    if not isinstance(known, Steps):
        return float(_at(carry, 0.0) - 0.5 * known**2)
    starts = (0.0, *known.ends)
    return Steps(known.ends, tuple(_at(carry, t) - 0.5 * _at(volatility, t) ** 2 for t in starts))


def _payoff(is_put: bool) -> Obstacle:
    if is_put:
        return Obstacle(lambda x: np.maximum(-np.expm1(x), 0.0), kinks=[0.0])
    return Obstacle(lambda x: np.maximum(np.expm1(x), 0.0), kinks=[0.0])


def _obstacle(segments: Life, strike: float, *, is_put: bool) -> Obstacle | None:
    """Return what exercise brings and when it is allowed; None where it never is."""
    sign = 1.0 if is_put else -1.0
    allowed = [segment for segment in segments if segment.exercisable]
    start, end = (allowed[0].start, allowed[-1].end) if allowed else (math.inf, -math.inf)
    dates = [s.end for s in segments if s.exercise_at_end and not start <= s.end <= end]
    if not allowed and not dates:
        return None
    window = (start, end) if allowed and len(allowed) < len(segments) else None
    always = len(allowed) == len(segments)
    at = None if always or not dates else dates
    if not any(segment.escrow > 0.0 for segment in segments):
        own = _payoff(is_put)
        return Obstacle(own.value, own.kinks, during=window, at=at)
    escrow = Escrow.of(segments, strike)

    def value(x: Vector, t: float) -> Vector:
        return np.maximum(-sign * (np.expm1(x) + escrow.at(t)), 0.0)

    def kink(t: float) -> float:
        return math.log(max(1.0 - escrow.at(t), GONE))

    return Obstacle(value, [kink], during=window, at=at)


@dataclass(frozen=True, slots=True, eq=False)
class Escrow:
    """What the dividends still due are worth, in strikes, as a function of time; at a dividend's time without it.

    Parameters
    ----------
    ends : tuple of float
    values, rates : tuple of float
        The escrow at the end of each segment, before the dividend there, and the segment's rate.
    """

    ends: tuple[float, ...]
    values: tuple[float, ...]
    rates: tuple[float, ...]

    @classmethod
    def of(cls, segments: Life, strike: float) -> Escrow:
        """Return the escrow of a contract."""
        ends, values, rates = zip(*((s.end, s.escrow / strike, s.rate) for s in segments), strict=True)
        return cls(ends, values, rates)

    def at(self, t: float) -> float:
        """Return the escrow at the time t."""
        k = min(bisect_right(self.ends, t), len(self.ends) - 1)
        return self.values[k] * math.exp(-self.rates[k] * (self.ends[k] - t)) if t < self.ends[k] else 0.0


def _events(segment: Segment, strike: float, restarts: bool) -> list[Event]:
    """Return what happens at the end of a segment, where something does."""
    kept, amount = 1.0 - segment.fraction, segment.amount / strike
    if segment.fraction == 0.0 and amount == 0.0:
        # The obstacle jumps, a neighbour's spot does, or a contact set begins.
        return [Event(segment.end, cash=0.0)] if segment.due != 0.0 or restarts else []
    if amount == 0.0:
        return [Event(segment.end, lambda x: x + math.log(kept))] if kept > 0.0 else [_ruin(segment)]
    return [Event(segment.end, lambda x: np.log(np.maximum(kept * np.exp(x) - amount, GONE)))]


def _ruin(segment: Segment) -> Event:
    return Event(segment.end, lambda x: np.full(x.shape, math.log(GONE)))


def _left_end(segments: Life, own: LocalTerms | None, strike: float, spot: float) -> float | None:
    """Return the left end of the interval where dividends may use the spot up; None where they do not.

    There the place falls without bound, so that the interval cannot be chosen by how far it comes.
    """
    amounts = [segment.amount / strike for segment in segments if segment.amount > 0.0]
    if not amounts:
        return None
    most = max(s.volatility for s in segments) if own is None else float(own.volatility.values.max())
    variance = 0.0
    lowest = math.log(spot)
    for segment in segments:
        volatility = segment.volatility if own is None else most
        variance += volatility**2 * segment.duration
        carry = (segment.rate - segment.dividend_yield - 0.5 * volatility**2) * segment.duration
        spot = max(spot * math.exp(carry) * (1.0 - segment.fraction) - segment.amount / strike, GONE)
        lowest = min(lowest, max(math.log(spot), math.log(min(amounts))))
    deviation = math.sqrt(variance)
    low = lowest - WIDTH * deviation
    dividend = math.log(min(amounts))
    return (
        min(low, dividend - BELOW_DIVIDENDS * deviation)
        if low < dividend + BELOW_DIVIDENDS * deviation
        else low
    )
