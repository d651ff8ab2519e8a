"""The life of an option cut at its events: segments between curve knots, ex-times and exercise times."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.carry import rate_and_yield
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import PiecewiseConstant, at
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

# Largest dividend that makes no difference, as a share of the strike or of the spot; chosen.
NEGLIGIBLE = 1e-10
SAME_TIME = 1e-12  # Largest distance of two times that are one, as a share of the expiry; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """The segments of all contracts of a book in columns of shape (m,): times without events, and what ends them.

    Parameters
    ----------
    start, end : Vector
        Years from now.
    rate, dividend_yield, volatility : Vector
        Per year, and per sqrt(year); where the volatility is local, the number that stands for it (`LocalTerms`).
    exercisable : bool array
        Whether the holder may exercise at every time of the segment, both ends included.
    exercise_at_end : bool array
        Whether the holder may exercise at its end, before the dividends there.
    fraction : Vector
        The spot's drop at the end as a share of it.
    due : Vector
        Cash dividends at the end, money, in either dividend model.
    """

    start: Vector
    end: Vector
    rate: Vector
    dividend_yield: Vector
    volatility: Vector
    exercisable: BoolVector
    exercise_at_end: BoolVector
    fraction: Vector
    due: Vector

    @property
    def duration(self) -> Vector:
        """Length of each segment in years, shape (m,)."""
        return self.end - self.start

    def take(self, chosen: NDArray[np.int64] | slice) -> Segments:
        """Return the segments of these indices."""
        return Segments(*(getattr(self, name)[chosen] for name in self.__slots__))

    @classmethod
    def concatenated(cls, parts: Sequence[Segments]) -> Segments:
        """Return the segments of several books in one, in their order."""
        return cls(*map(np.concatenate, zip(*map(columns_of, parts), strict=True)))

    @classmethod
    def of_rows(cls, rows: Sequence[Row]) -> Segments:
        """Return the columns of these rows."""
        columns = np.array(rows, dtype=np.float64).reshape(len(rows), len(cls.__slots__)).T
        start, end, rate, dividend_yield, volatility, exercisable, at_end, fraction, due = columns
        allowed = exercisable != 0.0, at_end != 0.0
        return cls(start, end, rate, dividend_yield, volatility, *allowed, fraction, due)


columns_of = attrgetter(*Segments.__slots__)
Row: TypeAlias = tuple[
    float, float, float, float, float, bool, bool, float, float
]  # the columns of `Segments`


@dataclass(frozen=True, slots=True)
class Segment:
    """One segment of a contract: the columns of `Segments`, and what follows from the dividend model.

    In the escrowed model the spot here is S* = S - A(t), A(t) the present value of the cash dividends still due, which
    is lognormal and does not jump; exercise at t brings K - A(t) - S* (a put) or its negative (a call).

    Parameters
    ----------
    start, end, rate, dividend_yield, volatility, exercisable, exercise_at_end, fraction, due
        As in `Segments`.
    amount : float
        With `fraction` the spot's drop at the end, s -> max(s (1 - fraction) - amount, 0). Escrowed: 0.
    escrow : float
        A at the end of the segment, before the dividends there; e^{-rate (end - t)} as much at t. 0 in the spot model.
    """

    start: float
    end: float
    rate: float
    dividend_yield: float
    volatility: float
    exercisable: bool
    exercise_at_end: bool
    fraction: float
    due: float
    amount: float
    escrow: float

    @property
    def duration(self) -> float:
        """Length of the segment in years."""
        return self.end - self.start

    def escrow_at(self, time: float) -> float:
        """Return A at `time` (years from now) in the segment, money; at its end before the dividends there."""
        return self.escrow * math.exp(-self.rate * max(self.end - time, 0.0))


@dataclass(frozen=True, slots=True)
class LocalTerms:
    """A local volatility, and the number that stands for it in the segments.

    What a segment's volatility exceeds that number by is added to the local one: a parallel shift.
    """

    volatility: LocalVolatility
    reference: float

    @classmethod
    def of(cls, option: Option, market: Market) -> LocalTerms | None:
        """Return those of a contract; None where the volatility does not depend on the spot."""
        volatility = market.volatility
        if not isinstance(volatility, LocalVolatility):
            return None
        return cls(volatility, volatility.reference(market.spot, option.strike, option.expiry))


def segment_rows(option: Option, market: Market, local: LocalTerms | None) -> list[Row]:
    """Cut the option's life at its events, in the order of time; one that has expired has one segment of length 0.

    Raises
    ------
    InvalidInputError
        Escrowed dividends go with a curve of rates and a settlement lag.
    """
    T, american = option.expiry, option.exercise == "american"
    volatility = market.volatility if local is None else local.reference
    assert not isinstance(volatility, LocalVolatility)
    curves = (*rate_and_yield(option, market), volatility)
    dividends = market.cash_dividends or market.proportional_dividends
    if not (dividends or option.exercise_times or option.exercise_start or market.has_curves()):
        rate, dividend_yield, sigma = (at(curve, 0.0) for curve in curves)
        return [(0.0, T, rate, dividend_yield, sigma, american, american, 0.0, 0.0)]
    least = NEGLIGIBLE * option.strike
    cash = [d for d in market.cash_dividends if 0.0 < d.time <= T and d.amount > least]
    proportional = [d for d in market.proportional_dividends if 0.0 < d.time <= T and d.fraction > NEGLIGIBLE]
    if market.dividend_model == "escrowed" and cash and curves[0] is not market.rate:
        allowed = "0 where dividends are escrowed and the rate is a curve"
        raise InvalidInputError("settlement_lag", option.settlement_lag, allowed)
    cuts = {T, *(d.time for d in cash), *(d.time for d in proportional), *option.exercise_times}
    if 0.0 < option.exercise_start < T:
        cuts.add(option.exercise_start)
    for curve in curves:
        if isinstance(curve, PiecewiseConstant):
            cuts.update(curve.knots(0.0, T))
    ends = _distinct(sorted(cuts), T) if T > 0.0 else [0.0]
    amounts = _by_end(ends, ((d.time, d.amount) for d in cash))
    fractions = _by_end(ends, ((d.time, d.fraction) for d in proportional))
    dates = _by_end(ends, ((time, 1.0) for time in option.exercise_times))
    allowed_from = option.exercise_start - SAME_TIME * T
    rows: list[Row] = []
    for k, end in enumerate(ends):
        start = ends[k - 1] if k else 0.0
        rate, dividend_yield, sigma = (at(curve, 0.5 * (start + end)) for curve in curves)
        at_end = (american and end >= allowed_from) or k in dates
        fraction = 1.0 - math.prod(1.0 - share for share in fractions.get(k, ()))
        due = math.fsum(amounts.get(k, ()))
        exercisable = american and start >= allowed_from
        rows.append((start, end, rate, dividend_yield, sigma, exercisable, at_end, fraction, due))
    return rows


def _by_end(ends: list[float], events: Iterable[tuple[float, float]]) -> dict[int, list[float]]:
    """Return the numbers of events by the place among the ends of the one at their time."""
    found: dict[int, list[float]] = {}
    same = SAME_TIME * ends[-1]
    for time, number in events:
        place = bisect_left(ends, time - same)
        if place < len(ends) and abs(ends[place] - time) <= same:
            found.setdefault(place, []).append(number)
    return found


def _distinct(times: list[float], expiry: float) -> list[float]:
    """Return the times without those that rounding alone keeps apart; the last is the expiry itself."""
    kept: list[float] = []
    for time in times:
        if time > SAME_TIME * expiry and (not kept or time - kept[-1] > SAME_TIME * expiry):
            kept.append(time)
    if expiry - kept[-1] <= SAME_TIME * expiry:
        kept[-1] = expiry
    return kept
