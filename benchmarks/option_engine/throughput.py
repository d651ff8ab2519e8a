"""What does a batch cost by its size, threads, Greeks and shared solves, and what does one call cost?"""

from collections.abc import Mapping
from functools import partial
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.problems.portfolios import Portfolio, everyday, option_chains, spot_ladders
from pricing_core.american import Market, Option, price, price_many
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE

TOLERANCE = 1e-5
LATENCY_TURNS = 25
PRICE_ONLY, ALL_GREEKS, TWO_THREADS = (
    "price only, one thread",
    "all Greeks, one thread",
    "price only, two threads",
)
PRICE_BY_DEFAULT, GREEKS_BY_DEFAULT = "price only, default tolerance", "all Greeks, default tolerance"
LADDERS, CHAINS = "spot ladders of 200 points", "chains of 100 strikes x 10 expiries"
ONE_LADDER, ONE_CHAIN = "one such ladder per call", "one such chain per call"
SHARING: dict[str, Any] = {"share_solves": True}
CAN_SHARE = SHARING.keys() <= signature(price_many).parameters.keys()


class Rate(NamedTuple):
    """The time of one row, in microseconds, where `rows` are priced by one call."""

    what: str
    rows: int
    microseconds: float

    @property
    def per_second(self) -> float:
        """Return the rows priced in a second."""
        return 1e6 / self.microseconds


class Batch(NamedTuple):
    """A portfolio, and the arguments with which `price_many` is called."""

    portfolio: Portfolio
    options: Mapping[str, Any]


def batch_rates(rows: int) -> dict[str, Rate]:
    """Time everyday contracts with and without Greeks and on two threads, and smaller and smaller batches."""
    contracts = everyday(rows)
    batches = {
        PRICE_ONLY: Batch(contracts, {"greeks": "none", "threads": 1}),
        ALL_GREEKS: Batch(contracts, {"greeks": "standard", "threads": 1}),
        TWO_THREADS: Batch(contracts, {"greeks": "none", "threads": 2}),
        PRICE_BY_DEFAULT: Batch(contracts, {"greeks": "none", "threads": 1, "tolerance": DEFAULT_TOLERANCE}),
        GREEKS_BY_DEFAULT: Batch(
            contracts, {"greeks": "standard", "threads": 1, "tolerance": DEFAULT_TOLERANCE}
        ),
    }
    count = rows // 8
    while count >= 1:
        few = contracts.take(np.arange(count))
        batches[f"price only, one thread, {count} per call"] = Batch(few, {"greeks": "none", "threads": 1})
        count //= 8
    return _rates(batches)


def shared_rates(ladders: int, chains: int) -> dict[str, Rate]:
    """Time spot ladders and option chains with shared solves, many and one per call."""
    options = {"greeks": "none", "threads": 1, **SHARING}
    return _rates(
        {
            LADDERS: Batch(spot_ladders(ladders), options),
            CHAINS: Batch(option_chains(chains), options),
            ONE_LADDER: Batch(spot_ladders(1), options),
            ONE_CHAIN: Batch(option_chains(1), options),
        }
    )


def sharing_difference(portfolio: Portfolio) -> float:
    """Return how far prices from shared solves are from those without, at most, as a fraction of the strike."""
    asked = partial(price_many, portfolio.columns(), tolerance=TOLERANCE, greeks="none", threads=1)
    return float(np.max(np.abs(asked(**SHARING)["price"] - asked()["price"]) / portfolio.strike))


def latency() -> float:
    """Return the least time of one warm `price()` with all Greeks, in microseconds."""
    option, market = Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2)
    call = partial(price, option, market, tolerance=TOLERANCE)
    (seconds,) = least_seconds([Task((call,))], LATENCY_TURNS)
    return 1e6 * seconds


def _rates(batches: Mapping[str, Batch]) -> dict[str, Rate]:
    tasks = [
        Task((partial(price_many, batch.portfolio.columns(), **{"tolerance": TOLERANCE, **batch.options}),))
        for batch in batches.values()
    ]
    return {
        what: Rate(what, len(batch.portfolio), 1e6 * seconds / len(batch.portfolio))
        for (what, batch), seconds in zip(batches.items(), least_seconds(tasks), strict=True)
    }
