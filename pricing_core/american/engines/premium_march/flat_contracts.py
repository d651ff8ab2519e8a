"""American contracts in a flat market: which there are, and their prices from the kernel's solvers of puts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.book import CURVES, Book, Rows
from pricing_core.american.book.prices import Prices, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, PARALLEL, of_dividends_not_due
from pricing_core.american.engines.engine import Request
from pricing_core.arrays import BoolVector, Vector

GREEKS: tuple[Greeks, ...] = (
    "none",
    "standard",
    "extended",
)  # In the order of the kernel's numbers for them.
SMALLEST_SPREAD = 1e-7  # Smallest standard deviation of ln S at expiry that the kernel takes.


@dataclass(frozen=True, slots=True, eq=False)
class Puts:
    """Dimensionless parameters of puts; every field has shape (n,).

    Parameters
    ----------
    x : Vector
        ln(S/K).
    rate, dividend, spread : Vector
        r T, q T, sigma sqrt(T).
    """

    x: Vector
    rate: Vector
    dividend: Vector
    spread: Vector

    def take(self, rows: NDArray[np.intp]) -> Puts:
        """Return some of the puts."""
        return Puts(self.x[rows], self.rate[rows], self.dividend[rows], self.spread[rows])


def is_flat(book: Book) -> BoolVector:
    """Tell American contracts without events and with a positive volatility, where the kernel is compiled."""
    if kernel.price_options is None:
        return np.zeros(book.count, dtype=bool)
    now = book.now
    flat = now.exercisable & (now.volatility * np.sqrt(now.end) >= SMALLEST_SPREAD) & (book.spot > 0.0)
    if book.local is not None:
        flat &= ~book.is_local()
    return flat if book.is_plain else flat & ~book.has_events()


def puts_of(book: Book) -> Puts:
    """Return the puts: a call is one with spot and strike, and rate and yield, exchanged."""
    segments, expiry = book.segments, book.segments.end
    x = np.log(book.spot / book.strike)
    return Puts(
        np.where(book.is_put, x, -x),
        np.where(book.is_put, segments.rate, segments.dividend_yield) * expiry,
        np.where(book.is_put, segments.dividend_yield, segments.rate) * expiry,
        segments.volatility * np.sqrt(expiry),
    )


def price_flat(book: Book, request: Request, *, method: str) -> Prices:
    """Price flat contracts; those that are not found are not `settled`."""
    now, greeks = book.segments, request.greeks
    columns, exercised, settled, steps = kernel.price_options(
        book.is_put,
        book.spot,
        book.strike,
        now.end,
        now.rate,
        now.dividend_yield,
        now.volatility,
        request.tolerance,
        GREEKS.index(greeks),
        request.share_solves,
        request.threads,
        request.interrupt,
    )
    lists: dict[str, Any] = {"complete": True}
    if greeks != "none":
        lists[DIVIDENDS] = of_dividends_not_due(book)
    if greeks == "extended":
        lists |= _buckets(book, columns)
    return prices(
        book.count,
        exercised=exercised,
        settled=settled,
        method=method,
        solves=1,
        steps=steps,
        **columns,
        **lists,
    )


def _buckets(book: Book, found: dict[str, Vector]) -> dict[str, Any]:
    """Return the buckets of curves that do not change any more, with their errors; `complete` tells where all are."""
    expiry = book.segments.end
    columns: dict[str, Any] = {"complete": np.ones(book.count, dtype=bool)}
    for name in CURVES:
        times = getattr(book.listed, name)
        if times.values.size == 0:
            columns[BUCKETS[name]] = columns[error_of(BUCKETS[name])] = times
            continue
        for bucket, parallel in (
            (BUCKETS[name], PARALLEL[name]),
            (error_of(BUCKETS[name]), error_of(PARALLEL[name])),
        ):
            columns[bucket], whole = _whole_in_one_piece(times, expiry, found[parallel])
        columns["complete"] &= whole
    return columns


def _whole_in_one_piece(times: Ragged, expiry: Vector, derivative: Vector) -> tuple[Ragged, BoolVector]:
    """Return the buckets of curves of which one piece alone holds before expiry, and for which contracts that is so."""
    values, whole = np.zeros(times.values.size), np.ones(expiry.size, dtype=bool)
    for row in np.flatnonzero(times.counts()).tolist():
        ends: Rows = times.first[row : row + 2]
        pieces = times.values[ends[0] : ends[1]]
        values[ends[0]] = derivative[row]
        whole[row] = pieces.size == 1 or bool(pieces[0] >= expiry[row])
        if not whole[row]:
            values[ends[0] : ends[1]] = math.nan
    return Ragged(times.first, values), whole
