"""The contracts that are priced: the published grid, random everyday contracts, a wide range, ladders and chains.

Expiries are whole days over 360, so that a library that counts days (Actual/360) sees the same floats.
"""

from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector

DAYS_PER_YEAR = 360
STRIKE = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Portfolio:
    """American contracts, one per row; every field has shape (n,).

    Parameters
    ----------
    option_type : array of str
    spot, strike : Vector
        Money.
    days : array of int
        Days to expiry; `expiry` is in years of 360 days.
    rate, dividend_yield : Vector
        Per year, continuously compounded.
    volatility : Vector
        Per square root of a year.
    """

    option_type: NDArray[np.str_]
    spot: Vector
    strike: Vector
    days: NDArray[np.int64]
    rate: Vector
    dividend_yield: Vector
    volatility: Vector

    def __len__(self) -> int:
        return len(self.spot)

    @property
    def expiry(self) -> Vector:
        """Return the time to expiry in years."""
        return self.days / DAYS_PER_YEAR

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the contracts as columns of `price_many`."""
        names = ("option_type", "spot", "strike", "expiry", "rate", "dividend_yield", "volatility")
        return {name: getattr(self, name) for name in names}

    def take(self, rows: NDArray[Any]) -> "Portfolio":
        """Return the rows that an index or a mask selects."""
        return Portfolio(*(getattr(self, field.name)[rows] for field in fields(self)))

    def sample(self, count: int) -> NDArray[np.intp]:
        """Return the indices of `count` rows (all where there are fewer), the same ones at every call."""
        chosen = np.random.default_rng(len(self)).permutation(len(self))[:count]
        return np.sort(chosen)


def andersen_lake_offengenden() -> Portfolio:
    """Return the 6,000 puts of Andersen, Lake and Offengenden (2016), the cheap ones not yet left out."""
    rows = product(
        (25.0, 50.0, 80.0, 90.0, 100.0, 110.0, 120.0, 150.0, 175.0, 200.0),
        (30, 90, 180, 270, 360),
        (0.02, 0.04, 0.06, 0.08, 0.10),
        (0.0, 0.04, 0.08, 0.12),
        (0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    )
    spot, days, rate, dividend_yield, volatility = np.array(list(rows)).T
    return _at_one_strike(np.full(len(spot), "put"), spot, days, rate, dividend_yield, volatility)


def everyday(count: int, seed: int = 1) -> Portfolio:
    """Return random puts and calls within everyday ranges.

    S/K 0.6-1.6, 10 days to 3 years, volatility 10-60 %, rate 0.5-10 % (all log-uniform), yield 0-10 % (uniform).
    """
    random = np.random.default_rng(seed)
    spot = STRIKE * _log_uniform(random, 0.6, 1.6, count)
    days = np.rint(_log_uniform(random, 10, 3 * DAYS_PER_YEAR, count))
    volatility = _log_uniform(random, 0.1, 0.6, count)
    rate = _log_uniform(random, 0.005, 0.1, count)
    dividend_yield = random.uniform(0.0, 0.1, count)
    return _at_one_strike(_either_type(random, count), spot, days, rate, dividend_yield, volatility)


def wide(count: int, seed: int = 2) -> Portfolio:
    """Return random puts and calls within wide ranges.

    S/K 0.4-2.5, 5 days to 10 years, volatility 3-150 % (all log-uniform), rate and yield 0-15 % (uniform).
    """
    random = np.random.default_rng(seed)
    spot = STRIKE * _log_uniform(random, 0.4, 2.5, count)
    days = np.rint(_log_uniform(random, 5, 10 * DAYS_PER_YEAR, count))
    volatility = _log_uniform(random, 0.03, 1.5, count)
    rate, dividend_yield = random.uniform(0.0, 0.15, (2, count))
    return _at_one_strike(_either_type(random, count), spot, days, rate, dividend_yield, volatility)


def spot_ladders(count: int, points: int = 200) -> Portfolio:
    """Return `count` everyday contracts, each at `points` spots from half the strike to one and a half."""
    contracts = everyday(count, seed=3)
    ladder = contracts.take(np.repeat(np.arange(count), points))
    spot = np.tile(STRIKE * np.linspace(0.5, 1.5, points), count)
    return replace(ladder, spot=spot)


def option_chains(count: int, strikes: int = 100, expiries: int = 10) -> Portfolio:
    """Return `count` everyday markets, each with a chain of strikes and expiries.

    Strikes 60-160 % of the spot, expiries from 30 days to 3 years.
    """
    chains = everyday(count, seed=4).take(np.repeat(np.arange(count), strikes * expiries))
    ladder = STRIKE * np.linspace(0.6, 1.6, strikes)
    dates = np.rint(np.linspace(30, 3 * DAYS_PER_YEAR, expiries)).astype(np.int64)
    return replace(
        chains,
        spot=np.full(len(chains), STRIKE),
        strike=np.tile(np.repeat(ladder, expiries), count),
        days=np.tile(dates, count * strikes),
    )


def _at_one_strike(
    option_type: NDArray[np.str_],
    spot: Vector,
    days: Vector,
    rate: Vector,
    yields: Vector,
    volatility: Vector,
) -> Portfolio:
    strike = np.full(len(spot), STRIKE)
    return Portfolio(option_type, spot, strike, days.astype(np.int64), rate, yields, volatility)


def _log_uniform(random: np.random.Generator, low: float, high: float, count: int) -> Vector:
    return np.exp(random.uniform(np.log(low), np.log(high), count))


def _either_type(random: np.random.Generator, count: int) -> NDArray[np.str_]:
    return np.where(random.random(count) < 0.5, "put", "call")
