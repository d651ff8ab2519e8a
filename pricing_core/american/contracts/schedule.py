"""The life of an option cut at its events: segments between curve knots, ex-times and exercise times.

In the escrowed model the spot here is S* = S - A(t), A(t) the present value of the cash dividends still due, which
is lognormal and does not jump; exercise at t brings K - A(t) - S* (a put) or its negative (a call).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass

from pricing_core.american.contracts.carry import rate_and_yield
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import PiecewiseConstant, at
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.errors import InvalidInputError

# Largest dividend that makes no difference, as a share of the strike or of the spot; chosen.
NEGLIGIBLE = 1e-10
SAME_TIME = 1e-12  # Largest distance of two times that are one, as a share of the expiry; chosen.


@dataclass(frozen=True, slots=True)
class Segment:
    """An interval of time without events inside, and the event at its end.

    Parameters
    ----------
    start, end : float
        Years from now.
    rate, dividend_yield, volatility : float
        Per year, and per sqrt(year); where the volatility is local, the number that stands for it (`LocalTerms`).
    exercisable : bool
        Whether the holder may exercise at every time of the segment, both ends included.
    exercise_at_end : bool
        Whether the holder may exercise at its end, before the dividends there.
    fraction, amount : float
        The spot's drop at the end, s -> max(s (1 - fraction) - amount, 0). Escrowed: amount is 0.
    escrow : float
        A at the end of the segment, before the dividends there; e^{-rate (end - t)} as much at t. 0 in the spot model.
    due : float
        Cash dividends at the end, money, in either model.
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


@dataclass(frozen=True, slots=True)
class Schedule:
    """An option's segments from now to expiry, and the spot that diffuses in them.

    Parameters
    ----------
    is_put : bool
    strike, spot : float
        Money; the spot is S* in the escrowed model.
    segments : tuple of Segment
        In the order of time, at least one; the last one ends at expiry.
    local : LocalTerms or None
        None where the volatility does not depend on the spot.
    """

    is_put: bool
    strike: float
    spot: float
    segments: tuple[Segment, ...]
    local: LocalTerms | None = None


def make_schedule(option: Option, market: Market) -> Schedule:
    """Cut the option's life at its events; one that has expired is one segment of length 0.

    Raises
    ------
    InvalidInputError
        Escrowed dividends are worth the spot or more, or go with a curve of rates and a settlement lag.
    """
    T = option.expiry
    local, volatility = None, market.volatility
    if isinstance(volatility, LocalVolatility):
        local = LocalTerms(volatility, volatility.reference(market.spot, option.strike, T))
        volatility = local.reference
    curves = (*rate_and_yield(option, market), volatility)
    dividends = market.cash_dividends or market.proportional_dividends
    if not (dividends or option.exercise_times or option.exercise_start or market.has_curves()):
        american = option.exercise == "american"
        rate, dividend_yield, sigma = (at(curve, 0.0) for curve in curves)
        whole = Segment(0.0, T, rate, dividend_yield, sigma, american, american, 0.0, 0.0, 0.0, 0.0)
        return Schedule(option.is_put, option.strike, market.spot, (whole,), local)
    least = NEGLIGIBLE * option.strike
    cash = [d for d in market.cash_dividends if 0.0 < d.time <= T and d.amount > least]
    proportional = [d for d in market.proportional_dividends if 0.0 < d.time <= T and d.fraction > NEGLIGIBLE]
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
    escrowed = market.dividend_model == "escrowed"
    if escrowed and cash and curves[0] is not market.rate:
        allowed = "0 where dividends are escrowed and the rate is a curve"
        raise InvalidInputError("settlement_lag", option.settlement_lag, allowed)
    segments: list[Segment] = []
    due = 0.0  # escrow just after the event at `end`
    for k in reversed(range(len(ends))):
        start, end = ends[k - 1] if k else 0.0, ends[k]
        rate, dividend_yield, sigma = (at(curve, 0.5 * (start + end)) for curve in curves)
        amount = math.fsum(amounts.get(k, ()))
        escrow = due + amount if escrowed else 0.0
        american = option.exercise == "american"
        segments.append(
            Segment(
                start,
                end,
                rate,
                dividend_yield,
                sigma,
                exercisable=american and start >= option.exercise_start - SAME_TIME * T,
                exercise_at_end=(american and end >= option.exercise_start - SAME_TIME * T) or k in dates,
                fraction=1.0 - math.prod(1.0 - fraction for fraction in fractions.get(k, ())),
                due=amount,
                amount=0.0 if escrowed else amount,
                escrow=escrow,
            )
        )
        due = escrow * math.exp(-rate * (end - start))
    if due > 0.0 and due >= market.spot:
        raise InvalidInputError("cash_dividends", due, "worth less today than the spot in the escrowed model")
    return Schedule(option.is_put, option.strike, market.spot - due, tuple(reversed(segments)), local)


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
