"""Error against time for every method and setting on one portfolio, all of them timed in turn."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from benchmarks.measuring.frontier import Point
from benchmarks.measuring.timing import TURNS, Task, least_seconds
from benchmarks.problems.portfolios import Portfolio
from pricing_core.american import Market, Option, price, price_many
from pricing_core.arrays import Vector

ENGINE = "this engine"
LCS_PATH = "this project's LCS path"
CRANK_NICOLSON = "this project's Crank-Nicolson"

ErrorMeasure: TypeAlias = Literal["rmse", "largest_error"]
SingleMethod: TypeAlias = Literal["lcs", "crank-nicolson"]
ERRORS: tuple[tuple[ErrorMeasure, str], ...] = (("rmse", "RMSE"), ("largest_error", "largest error"))
SINGLE_METHODS: tuple[tuple[str, SingleMethod], ...] = ((LCS_PATH, "lcs"), (CRANK_NICOLSON, "crank-nicolson"))


@dataclass(frozen=True, slots=True)
class Method:
    """One method at one setting.

    Parameters
    ----------
    family, setting : str
    task : Task
        Prices all rows.
    prices : callable
        Returns the prices as fractions of the strike.
    rows : array of int
        The rows of the portfolio that are priced.
    overhead : float
        Microseconds per row that are no part of the calculation.
    """

    family: str
    setting: str
    task: Task
    prices: Callable[[], Vector]
    rows: Any
    overhead: float = 0.0


class Measurement(NamedTuple):
    """Errors are fractions of the strike; `missing` rows got no price, and no error either."""

    family: str
    setting: str
    microseconds: float
    rmse: float
    largest_error: float
    contracts: int
    missing: int


def measure(methods: Sequence[Method], reference: Vector, turns: int = TURNS) -> tuple[Measurement, ...]:
    """Time all methods in turn and compare their prices with the reference, a fraction of the strike."""
    seconds = least_seconds([method.task for method in methods], turns)
    return tuple(_measured(*pair, reference) for pair in zip(methods, seconds, strict=True))


def _measured(method: Method, seconds: float, reference: Vector) -> Measurement:
    errors = np.abs(method.prices() - reference[method.rows])
    priced = errors[np.isfinite(errors)]
    rmse, largest = (np.sqrt(np.mean(priced**2)), np.max(priced)) if len(priced) else (np.nan, np.nan)
    microseconds = 1e6 * seconds / len(errors) - method.overhead
    missing = len(errors) - len(priced)
    return Measurement(
        method.family, method.setting, microseconds, float(rmse), float(largest), len(errors), missing
    )


def points(
    measurements: Iterable[Measurement], family: str, error: ErrorMeasure = "rmse"
) -> tuple[Point, ...]:
    """Return the points (error, time) of one family that priced every row."""
    return tuple(
        Point(getattr(one, error), one.microseconds)
        for one in measurements
        if one.family == family and one.missing == 0
    )


def engine_methods(portfolio: Portfolio, tolerances: Iterable[float]) -> tuple[Method, ...]:
    """Return `price_many` on one thread, price only, all rows in one call."""
    columns = portfolio.columns()
    rows = np.arange(len(portfolio))

    def method(tolerance: float) -> Method:
        solve = partial(price_many, columns, tolerance=tolerance, greeks="none", threads=1)
        return Method(
            ENGINE,
            f"tolerance {tolerance:.0e}",
            Task((solve,)),
            lambda: solve()["price"] / portfolio.strike,
            rows,
        )

    return tuple(method(tolerance) for tolerance in tolerances)


def single_methods(portfolio: Portfolio, rows: Any, tolerances: Sequence[float]) -> tuple[Method, ...]:
    """Return the LCS path and Crank-Nicolson, one contract per call, on a few rows of the portfolio."""
    few = portfolio.take(rows)
    contracts = tuple(_contracts(few))

    def method(family: str, name: SingleMethod, tolerance: float) -> Method:
        calls = tuple(
            partial(price, *contract, tolerance=tolerance, method=name, greeks="none")
            for contract in contracts
        )
        return Method(
            family,
            f"tolerance {tolerance:.0e}",
            Task(calls),
            lambda: np.array([call().price for call in calls]) / few.strike,
            rows,
        )

    return tuple(
        method(family, name, tolerance) for family, name in SINGLE_METHODS for tolerance in tolerances
    )


def _contracts(portfolio: Portfolio) -> Iterable[tuple[Option, Market]]:
    for row in zip(*portfolio.columns().values(), strict=True):
        option_type, spot, strike, expiry, rate, dividend_yield, volatility = (item.item() for item in row)
        yield (
            Option(option_type, strike, expiry),
            Market(spot, rate=rate, volatility=volatility, dividend_yield=dividend_yield),
        )
