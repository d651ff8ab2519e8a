"""The engine of the kernel's march: contracts with events, and those whose exercise region has two boundaries."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.differences import stored
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.formulas import has_formula, may_exercise
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.obstacle_march.march_book import march_book
from pricing_core.american.engines.obstacle_march.segment_greeks import (
    by_parameters,
    by_spot,
    lacks_cuts,
    with_entries,
)
from pricing_core.arrays import BoolVector, Vector

if TYPE_CHECKING:
    from pricing_core._kernels import MarchedSegments

# Largest standard deviation of ln S at expiry, distance of the spot from the strike in such deviations, and drift of a
# segment in its own: on a wider grid the ends' spots are too far apart for the equations' numbers; measured.
LARGEST_DEVIATION, FURTHEST, LARGEST_DRIFT = 4.0, 30.0, 6.0


class CompiledMarch:
    """Whatever happens before expiry, with constant coefficients in between or a local volatility."""

    name = "obstacle march"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts that diffuse in every segment, not too far for its grids."""
        if kernel.march_segments is None:
            return np.zeros(book.count, dtype=bool)
        segments, spot = book.segments, book.spot - book.escrow_now()
        variance = segments.volatility**2 * segments.duration
        deviation = np.sqrt(np.add.reduceat(variance, book.first[:-1]))
        served = (book.expiry > 0.0) & (deviation <= LARGEST_DEVIATION)
        drift = np.abs(segments.rate - segments.dividend_yield) * segments.duration
        diffuses = (variance > 0.0) & (drift <= LARGEST_DRIFT * np.sqrt(variance))
        served &= np.logical_and.reduceat(diffuses, book.first[:-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.abs(np.log(spot / book.strike)) > FURTHEST * deviation
        return served & (spot > 0.0) & ~far

    def solve(self, book: Book, request: Request) -> Prices:
        """March to the tolerances, and walk back for the Greeks; of two grids the finer one's values extrapolated."""
        with np.errstate(invalid="ignore"):  # of what was not settled
            return self._solved(book, request)

    def _solved(self, book: Book, request: Request) -> Prices:
        found = march_book(book, request)
        strike, escrow = book.strike, book.escrow_now()
        settled = found.settled & np.isfinite(found.value)
        columns, complete = by_spot(book, found), settled
        if request.greeks == "none":
            columns = {name: columns[name] for name in ("delta", "gamma")}
        else:
            if request.greeks == "standard":
                del columns["charm"], columns["charm_error"]
            columns |= _by_parameters(book, found, settled & ~found.exercised, request)
            complete = settled & ~np.isnan(columns["vega"])
        european = _european(book, found.value, request)
        interrupted = request.is_interrupted()
        return priced(
            book,
            value=strike * found.value,
            european=european,
            error=np.where(settled, strike * found.error, math.nan),
            boundary=strike * found.boundary + escrow,
            exercised=found.exercised,
            settled=settled,
            complete=complete,
            method="obstacle-march",
            status=np.where(interrupted & ~complete, "deadline", "ok").astype(object),
            message=_outside(book),
            steps=found.steps,
            solves=found.levels,
            **columns,
        )

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return no boundary: one solve that keeps its contact sets tells those of all times."""
        del book, request
        nothing = np.full(times.size, math.nan)
        return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))


def _by_parameters(book: Book, found: MarchedSegments, held: BoolVector, request: Request) -> dict[str, Any]:
    """Return the Greeks by the parameters as columns; contracts without a segment for each are marched again with one.

    `held` tells which contracts they are wanted of, shape (n,).
    """
    extended = request.greeks == "extended"
    columns = by_parameters(book, found, extended=extended)
    rows = np.flatnonzero(held & lacks_cuts(book, extended=extended))
    if rows.size:
        cut = with_entries(book.take(rows), extended=extended)
        again = march_book(cut, request.take(rows))
        columns |= stored(columns, rows, by_parameters(cut, again, extended=extended))
    return columns


def _european(book: Book, value: Vector, request: Request) -> Vector:
    """Return the values without early exercise, money, shape (n,): by formula, or marched as well."""
    european = np.where(may_exercise(book), math.nan, book.strike * value)
    held = book.european()
    rows = np.flatnonzero(has_formula(held))
    if rows.size:
        european[rows] = european_columns(held.take(rows), "none")["value"]
    rows = np.flatnonzero(np.isnan(european))
    if rows.size:
        without = march_book(held.take(rows), replace(request.take(rows), greeks="none"))
        european[rows] = book.strike[rows] * without.value
    return european


def _outside(book: Book) -> str | NDArray[np.object_]:
    """Return what lies outside the nodes of each contract's local volatility, a sentence or nothing, shape (n,)."""
    if book.local is None:
        return ""
    found = np.full(book.count, "", dtype=object)
    for row in np.flatnonzero(book.is_local()).tolist():
        surface = book.local[row].volatility
        found[row] = surface.extrapolated(book.spot.item(row), book.strike.item(row), book.expiry.item(row))
    return found
