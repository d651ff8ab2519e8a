"""Contracts whose stated terms the engines do not know, and how their prices follow from those that the engines find.

The engines price an option that is paid at once, of a spot with a rate and a yield of its own (`contracts/carry.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, Prices, error_of, taken
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import at, integral, times_of
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector

RATE, YIELD = "rate_buckets", "dividend_yield_buckets"


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """What n contracts state beyond what the engines price.

    Parameters
    ----------
    lag : Vector, shape (n,)
        Years from exercise to payment.
    discount : Vector, shape (n,)
        D, what a unit of money paid after the lag is worth now.
    growth : Vector, shape (n,)
        d ln D / dt now, 1/year: what a curve of rates changes by over the lag.
    follows_rate : bool array, shape (n,)
        Whether the yield moves with the rate.
    has_yield : bool array, shape (n,)
        Whether a dividend yield is part of the yield.
    rate, dividend_yield : Ragged
        The `times` of the curves as stated, where there are any.
    """

    lag: Vector
    discount: Vector
    growth: Vector
    follows_rate: BoolVector
    has_yield: BoolVector
    rate: Ragged
    dividend_yield: Ragged

    @classmethod
    def of(cls, contracts: Sequence[tuple[Option, Market]]) -> Reduction | None:
        """Return the reduction of these contracts; None where the engines price each of them as it is stated."""
        if all(is_plain(option, market) for option, market in contracts):
            return None
        lags = [option.settlement_lag / DAYS_PER_YEAR for option, _ in contracts]
        rates = [market.rate for _, market in contracts]
        terms = [*zip(rates, lags, strict=True)]
        is_future = np.array([market.underlying == "future" for _, market in contracts], dtype=bool)
        is_quanto = np.array([market.foreign_rate is not None for _, market in contracts], dtype=bool)
        return cls(
            np.array(lags),
            np.exp([-integral(rate, lag) for rate, lag in terms]),
            np.array([at(rate, 0.0) - at(rate, lag) for rate, lag in terms]),
            is_future | is_quanto,
            ~is_future,
            Ragged.of([times_of(rate) for rate in rates]),
            Ragged.of([times_of(market.dividend_yield) for _, market in contracts]),
        )

    @classmethod
    def of_columns(cls, columns: Mapping[str, NDArray[Any]]) -> Reduction | None:
        """Return the reduction of contracts without curves; None where the engines price each of them as it is stated.

        Parameters
        ----------
        columns : mapping of str to array, shape (n,)
            "rate", and "lag" in years, "is_future" and "is_quanto" unless all are none of it.
        """
        if "lag" not in columns:
            return None
        rate, lag, is_future = columns["rate"], columns["lag"], columns["is_future"]
        follows_rate = is_future | columns["is_quanto"]
        if not (lag.any() or follows_rate.any()):
            return None
        none = Ragged.empty(rate.size)
        return cls(lag, np.exp(-rate * lag), np.zeros(rate.size), follows_rate, ~is_future, none, none)

    @classmethod
    def nothing(cls, count: int) -> Reduction:
        """Return the reduction of `count` contracts that the engines price as they are stated."""
        no, none = np.zeros(count, dtype=bool), Ragged.empty(count)
        return cls(np.zeros(count), np.ones(count), np.zeros(count), no, ~no, none, none)

    def take(self, rows: NDArray[np.intp]) -> Reduction:
        """Return the reduction of some of the contracts."""
        return Reduction(*(taken(getattr(self, field.name), rows) for field in fields(self)))

    @classmethod
    def concatenated(cls, parts: Sequence[Reduction]) -> Reduction:
        """Return the reductions of several books in one, in their order."""
        columns: list[Any] = []
        for field in fields(cls):
            pieces = [getattr(part, field.name) for part in parts]
            is_list = isinstance(pieces[0], Ragged)
            columns.append(Ragged.concatenated(pieces) if is_list else np.concatenate(pieces))
        return cls(*columns)

    def stated(self, found: Prices, engine_yield: Ragged) -> Prices:
        """Return the prices of the contracts as they are stated from those that the engines found.

        With W what the engines find, V = D W, and D depends on the rate over the lag and on time.

        Parameters
        ----------
        found : Prices
        engine_yield : Ragged
            The times of the pieces of the yield that the engines found derivatives by (`engine_times`).
        """
        added = {
            "theta": (self.growth * found.value, self.growth * found.error),
            "charm": (self.growth * found.delta, self.growth * found.delta_error),
            "rho": (
                np.where(self.follows_rate, found.dividend_rho, 0.0) - self.lag * found.value,
                np.where(self.follows_rate, found.dividend_rho_error, 0.0) + self.lag * found.error,
            ),
        }
        columns: dict[str, Any] = {name: getattr(found, name) for name in ("value", "european", "error")}
        for name in GREEKS:
            value, error = added.get(name, (0.0, 0.0))
            columns[name] = getattr(found, name) + value
            columns[error_of(name)] = getattr(found, error_of(name)) + np.abs(error)
        for name in ("dividend_rho", "dividend_rho_error"):
            columns[name] = np.where(self.has_yield | np.isnan(columns[name]), columns[name], 0.0)
        columns = {name: self.discount * column for name, column in columns.items()}
        lists = {column: getattr(found, column) for name in GREEK_LISTS for column in (name, error_of(name))}
        if found.rate_buckets.values.size or found.dividend_yield_buckets.values.size:
            rows = [self._buckets(found, row, engine_yield.row(row)) for row in range(found.count)]
            lists |= {column: Ragged.of([row[column] for row in rows]) for column in rows[0]}
        for name, each in lists.items():
            columns[name] = Ragged(each.first, self.discount[each.owner()] * each.values)
        return replace(found, **columns)

    def _buckets(self, found: Prices, row: int, grid: tuple[float, ...]) -> dict[str, list[float]]:
        """Return a contract's derivatives by the values of its stated curves, and their errors, not discounted."""
        times = {RATE: self.rate.row(row), YIELD: self.dividend_yield.row(row)}
        follows, lag = bool(self.follows_rate[row]), self.lag.item(row)
        result: dict[str, list[float]] = {}
        for ending, magnitude, value in (("", float, found.value), ("_error", abs, found.error)):
            by_rate, by_yield = (getattr(found, name + ending).row(row) for name in (RATE, YIELD))
            passed = len(times[RATE]) - len(by_rate)  # pieces of the rate that end within the lag
            result[RATE + ending] = []
            for piece, (start, end) in enumerate(_pieces(times[RATE]) if by_rate else ()):
                # The yield holds the rate of the lag later, less the rate now unless it moves with that.
                spans = [(1.0, start - lag, end - lag), (-1.0, start, end)] if lag > 0.0 else []
                spans += [(1.0, start, end)] if follows else []
                terms = [
                    magnitude(weight) * number for weight, number in _with_weights(grid, by_yield, spans)
                ]
                terms.append(by_rate[piece - passed] if piece >= passed else 0.0)
                terms.append(magnitude(-max(min(lag, end) - start, 0.0)) * value.item(row))
                result[RATE + ending].append(math.fsum(terms))
            result[YIELD + ending] = [
                math.fsum(
                    weight * number for weight, number in _with_weights(grid, by_yield, [(1.0, start, end)])
                )
                for start, end in (_pieces(times[YIELD]) if by_yield and times[YIELD] else ())
            ]
        return result


def engine_times(option: Option, market: Market) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the times by whose pieces the engines are to find derivatives by the rate and by the yield.

    The times of the yield include all times at which a piece of the stated curves may begin in what the engines price.
    """
    rate, dividend_yield = times_of(market.rate), times_of(market.dividend_yield)
    if is_plain(option, market) or not (rate or dividend_yield):
        return rate, dividend_yield
    lag = option.settlement_lag / DAYS_PER_YEAR
    later = tuple(time - lag for time in rate if time > lag) or ((1.0,) if rate else ())
    cuts = sorted({*rate, *later, *dividend_yield})
    return later, (*cuts, cuts[-1] + 1.0)


def is_plain(option: Option, market: Market) -> bool:
    """Tell whether the engines price the contract as it is stated, with a rate and a yield."""
    return option.settlement_lag == 0.0 and market.underlying == "spot" and market.foreign_rate is None


def _pieces(times: tuple[float, ...]) -> list[tuple[float, float]]:
    """Return start and end of the pieces of a curve with these times, the last of which has no end."""
    return [*pairwise((0.0, *times[:-1], math.inf))]


def _with_weights(
    grid: tuple[float, ...], numbers: tuple[float, ...], spans: Iterable[tuple[float, float, float]]
) -> Iterator[tuple[float, float]]:
    """Yield the numbers of the pieces of a grid, each with the sum of the weights of the spans that it lies in.

    Parameters
    ----------
    spans : iterable of (weight, start, end)
        Years from now; every piece lies in a span or outside.
    """
    for (low, high), number in zip(_pieces(grid), numbers, strict=True):
        inside = 0.5 * (low + high) if math.isfinite(high) else low + 0.5
        yield sum(weight for weight, start, end in spans if start <= inside <= end), number
