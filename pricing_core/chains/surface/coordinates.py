"""The coordinate in which a surface is fitted: that of the martingale which the spot is made of.

With cash dividends the spot S jumps, and neither Dupire's formula nor "total variances do not cross" hold in S. With
F_t the forward and D_t the value at t of the cash dividends that are due after t, up to the horizon, discounted with
r - q,

    S_t = (F_t - D_t) X_t + D_t,

X is a martingale that starts at 1 and does not jump, for F and D fall by the dividend as S does (Bermudez, Buehler,
Ferraris, Jordinson, Lamnouar and Overhaus 2006). An option on S struck at K is F - D options on X struck at
(K - D)/(F - D). Yields and proportional dividends are in F and need nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.carry import carry_yield
from pricing_core.american.contracts.curves import Curve, integral, times_of
from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.black_spread import black_spread, black_time_value
from pricing_core.arrays import Vector
from pricing_core.chains.surface.total_variance import Clock
from pricing_core.errors import InvalidInputError

LARGEST_DISTANCE = (
    35.0  # Largest |ln(K/F)| in standard deviations whose time value floating-point numbers reach.
)


@dataclass(frozen=True)
class Coordinates:
    """Forward, dividends due and discount factor of a market, and the coordinate x = ln((K - D)/(F - D)).

    Parameters
    ----------
    market : Market
        With cash dividends in the spot model, if any. Its volatility is not used.
    horizon : float
        Years: cash dividends up to this time count in D.

    Raises
    ------
    InvalidInputError
        The dividends are escrowed, or worth the spot or more.
    """

    market: Market
    horizon: float

    def __post_init__(self) -> None:
        if self.market.cash_dividends and self.market.dividend_model != "spot":
            raise InvalidInputError("dividend_model", self.market.dividend_model, '"spot" for a surface')
        if self.due(0.0) >= self.market.spot:
            raise InvalidInputError(
                "cash_dividends", self.due(0.0), f"worth less than the spot {self.market.spot} together"
            )

    def growth(self, time: float) -> float:
        """Return what one unit of the spot grows to, without cash dividends."""
        kept = math.prod(
            1.0 - dividend.fraction
            for dividend in self.market.proportional_dividends
            if 0.0 < dividend.time <= time
        )
        return kept * math.exp(integral(self.market.rate, time) - self.yield_integral(time))

    def due(self, time: float) -> float:
        """Return D, the value at a time of the cash dividends after it, money."""
        due = math.fsum(amount / growth for at, amount, growth in self._dividends if at > time)
        return self.growth(time) * due

    def forward(self, time: float) -> float:
        """Return F, the forward at a time, money."""
        due = math.fsum(amount / growth for at, amount, growth in self._dividends if at <= time)
        return self.growth(time) * (self.market.spot - due)

    def discount(self, time: float) -> float:
        """Return the present value of one unit of money paid at a time."""
        return math.exp(-integral(self.market.rate, time))

    def yield_integral(self, time: float) -> float:
        """Return the integral of the yield, with all that adds to it, from now to a time."""
        return integral(self._yield, time)

    @cached_property
    def clock(self) -> Clock:
        """At which pace X runs where dividends are due."""
        times = sorted({time for time, _, _ in self._dividends})
        starts = [0.0, *times]
        ratios = [self.due(start) / (self.forward(start) - self.due(start)) for start in starts]
        return Clock(tuple(times), tuple(ratios))

    def breaks(self, until: float) -> list[float]:
        """Return the times after 0 and before `until` at which D or the growth change their law."""
        paid = [dividend.time for dividend in self.market.cash_dividends]
        paid += [dividend.time for dividend in self.market.proportional_dividends]
        knots = [*times_of(self.market.rate), *times_of(self._yield)]
        return sorted({time for time in [*paid, *knots] if 0.0 < time < until})

    def x(self, strike: ArrayLike, time: float) -> Vector:
        """Return the coordinate of strikes, money; minus infinity at and below D."""
        due = self.due(time)
        with np.errstate(divide="ignore"):
            over = np.maximum(np.asarray(strike, dtype=np.float64) - due, 0.0)
            place: Vector = np.log(over / (self.forward(time) - due))
        return place

    def strike(self, x: ArrayLike, time: float) -> Vector:
        """Return the strikes at the coordinate, money."""
        due = self.due(time)
        return np.asarray(due + (self.forward(time) - due) * np.exp(x), dtype=np.float64)

    def variance(self, volatility: Vector, strike: Vector, time: float) -> tuple[Vector, Vector]:
        """Return the total variance of X that volatilities of S mean, and its derivative by the volatility, (n,).

        NaN where the strike is not above D, or so far away that the time value underflows.
        """
        forward, due = self.forward(time), self.due(time)
        if due == 0.0:
            return volatility**2 * time, 2.0 * volatility * time
        spread = volatility * math.sqrt(time)
        with np.errstate(all="ignore"):
            distance = np.abs(np.log(strike / forward))
            value, slope = black_time_value(distance, spread)
            unit = np.minimum(forward, strike) / np.minimum(forward - due, strike - due)
            place = np.abs(self.x(strike, time))
            own = black_spread(place, value * unit)
            own_slope = black_time_value(place, own)[1]
            reached = (strike > due) & (np.maximum(distance / spread, place / own) < LARGEST_DISTANCE)
            by_volatility = 2.0 * own * slope * unit / own_slope * math.sqrt(time)
        return np.where(reached, own**2, np.nan), np.where(reached, by_volatility, np.nan)

    def volatility(self, variance: Vector, strike: Vector, time: float) -> tuple[Vector, Vector]:
        """Return the volatilities of S that total variances of X mean, and their derivatives by those, (n,)."""
        forward, due = self.forward(time), self.due(time)
        if due == 0.0:
            found = np.sqrt(variance / time)
            return found, 0.5 / (found * time)
        spread = np.sqrt(variance)
        with np.errstate(all="ignore"):
            place = np.abs(self.x(strike, time))
            value, slope = black_time_value(place, spread)
            unit = np.minimum(forward - due, strike - due) / np.minimum(forward, strike)
            distance = np.abs(np.log(strike / forward))
            own = black_spread(distance, value * unit)
            own_slope = black_time_value(distance, own)[1]
            reached = (strike > due) & (np.maximum(distance / own, place / spread) < LARGEST_DISTANCE)
            by_variance = 0.5 * slope * unit / (spread * own_slope * math.sqrt(time))
        return np.where(reached, own / math.sqrt(time), np.nan), np.where(reached, by_variance, np.nan)

    @cached_property
    def _yield(self) -> Curve:
        return carry_yield(self.market)

    @cached_property
    def _dividends(self) -> list[tuple[float, float, float]]:
        """Return time, amount and growth until then of each dividend up to the horizon."""
        return [
            (dividend.time, dividend.amount, self.growth(dividend.time))
            for dividend in self.market.cash_dividends
            if 0.0 < dividend.time <= self.horizon
        ]
