"""One portfolio: reference values, errors and times of every method, ratios at equal error."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring.frontier import time_at
from benchmarks.option_engine.peer_methods import peer_methods
from benchmarks.option_engine.work_precision import (
    ENGINE,
    Measurement,
    engine_methods,
    measure,
    points,
    single_methods,
)
from benchmarks.problems.portfolios import Portfolio
from benchmarks.quantlib import american_engines
from benchmarks.quantlib.american_engines import FINITE_DIFFERENCES, QD_FP, CallOverhead
from pricing_core.american import price_many
from pricing_core.american.contracts.fields import TOLERANCE
from pricing_core.arrays import Vector

COMPARED = ((QD_FP, 1e-5), (QD_FP, 1e-6), (QD_FP, 2e-7), (FINITE_DIFFERENCES, 5e-5))  # at these RMSEs


@dataclass(frozen=True, slots=True)
class Effort:
    """The numbers of contracts and repeats of the measurements.

    Parameters
    ----------
    tolerances : tuple of float
        Tolerances of this engine.
    single_rows, single_tolerances
        Contracts and tolerances of the LCS path and Crank-Nicolson, which price one contract per call.
    screened_rows, slow_rows : int
        See `peer_methods`.
    """

    tolerances: tuple[float, ...]
    single_rows: int
    single_tolerances: tuple[float, ...]
    screened_rows: int
    slow_rows: int


class Ratio(NamedTuple):
    """How many times longer `peer` takes for the same RMSE, a fraction of the strike; times in microseconds.

    `strict` is the ratio with a whole European valuation taken off the peer's time. A ratio is 0 where this engine
    does not reach the RMSE, None where only the peer does not.
    """

    peer: str
    rmse: float
    engine_time: float | None
    peer_time: float | None
    ratio: float | None
    strict: float | None


@dataclass(frozen=True, slots=True)
class PortfolioStudy:
    """The measurements on one portfolio."""

    title: str
    contracts: int
    left_out: int
    measurements: tuple[Measurement, ...]
    ratios: tuple[Ratio, ...]


def study_portfolio(
    title: str,
    portfolio: Portfolio,
    effort: Effort,
    overhead: CallOverhead | None,
    least_price: float = -math.inf,
) -> PortfolioStudy:
    """Measure every method on the contracts priced above `least_price`, a fraction of the strike.

    Without QuantLib (`overhead` None) this project's methods alone, against the engine at its least tolerance.
    """
    reference, agreed = _reference(portfolio)
    counted = np.flatnonzero(agreed & (reference > least_price))
    contracts, value = portfolio.take(counted), reference[counted]
    few = contracts.sample(effort.single_rows)
    methods = (
        *engine_methods(contracts, effort.tolerances),
        *single_methods(contracts, few, effort.single_tolerances),
    )
    if overhead is not None:
        methods += peer_methods(
            contracts, value, screened=effort.screened_rows, slow=effort.slow_rows, overhead=overhead.empty
        )
    measurements = measure(methods, value)
    ratios = () if overhead is None else _ratios(measurements, overhead)
    return PortfolioStudy(title, len(contracts), int(np.sum(~agreed)), measurements, ratios)


def _reference(portfolio: Portfolio) -> tuple[Vector, NDArray[np.bool_]]:
    """Return the reference prices, fractions of the strike, and which of them to trust."""
    if american_engines.AVAILABLE:
        reference = american_engines.reference_prices(portfolio)
        return reference.price, reference.agreed
    table = price_many(portfolio.columns(), tolerance=TOLERANCE.least, greeks="none", threads=1)
    return table["price"] / portfolio.strike, np.isfinite(table["price"])


def _ratios(measurements: tuple[Measurement, ...], overhead: CallOverhead) -> tuple[Ratio, ...]:
    rest_of_european = overhead.european - overhead.empty
    ratios = []
    for peer, rmse in COMPARED:
        engine, other = (time_at(points(measurements, family), rmse) for family in (ENGINE, peer))
        if engine is None:
            ratios.append(Ratio(peer, rmse, None, other, 0.0, 0.0))
        elif other is None:
            ratios.append(Ratio(peer, rmse, engine, None, None, None))
        else:
            strict = (other - rest_of_european) / engine
            ratios.append(Ratio(peer, rmse, engine, other, other / engine, strict))
    return tuple(ratios)
