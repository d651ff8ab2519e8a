"""The engine of the kernel's march: contracts with events, and those whose exercise region has two boundaries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import Prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.differences import stored
from pricing_core.american.engines.engine import BoundariesAt, Request
from pricing_core.american.engines.exercise_region import closing_times
from pricing_core.american.engines.formulas import is_lognormal, may_exercise
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.obstacle_march.march_book import march_book
from pricing_core.american.engines.obstacle_march.segment_greeks import (
    by_parameters,
    by_spot,
    by_volatility,
    lacks_cuts,
    with_entries,
)
from pricing_core.arrays import BoolVector, Matrix, Vector

if TYPE_CHECKING:
    from pricing_core._kernels import MarchedSegments
    from pricing_core.american.engines.obstacle_march.boundaries import Traces

# Largest standard deviation of ln S at expiry, beyond which the spots of a grid overflow.
LARGEST_DEVIATION = 150.0
# Largest drift of a segment in its own deviations, and of all that drifts and drops in the whole one, beyond which too
# few cells are left for what diffuses. Measured.
LARGEST_DRIFT, LARGEST_RANGE = 60.0, 300.0
LARGEST_DROP = 0.95  # of the spot, that is counted into its range; chosen
LEAST_VOLATILITY = 1e-6  # Least volatility that is marched; chosen.
# Standard deviations from the strike from which on no grid reaches it, but for those that are wide for other reasons.
FURTHEST = 16.0


class CompiledMarch:
    """Whatever happens before expiry, with constant coefficients in between or a local volatility."""

    name = "compiled march"
    method = "obstacle-march"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts that diffuse in every segment, not too far for the grids."""
        if kernel.march_segments is None:
            return np.zeros(book.count, dtype=bool)
        segments, spot = book.segments, book.diffusing()
        variance = segments.volatility**2 * segments.duration
        served = (book.expiry > 0.0) & (book.deviation <= LARGEST_DEVIATION)
        diffuses = (variance > 0.0) & (segments.volatility >= least_volatility(book))
        served &= np.logical_and.reduceat(diffuses, book.first[:-1])
        return served & (spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """March to the tolerances, and walk back for the Greeks; of two grids the finer one's values extrapolated."""
        with np.errstate(invalid="ignore"):  # of what was not settled
            found = self._solved(book, request)
            return self._where_regions_close(book, request, found)

    def _where_regions_close(self, book: Book, request: Request, found: Prices) -> Prices:
        """March puts that miss their tolerance again, with steps that begin anew where their exercise region closes.

        The boundary falls so fast there that the steps of a whole segment tell their error ten times as large.
        """
        closes = closing_times(book)
        missed = found.settled & (found.error > request.tolerance * book.strike)
        rows = np.flatnonzero(missed & ~np.isnan(closes))
        if rows.size == 0 or request.is_interrupted():
            return found
        part = book.take(rows)
        cut = with_cuts(part, Ragged(np.arange(rows.size + 1), closes[rows]))
        again = self._solved(cut, request.take(rows))
        better = np.flatnonzero(again.settled & again.complete & (again.error < found.error[rows]))
        return found.replaced(rows[better], again.take(better))

    def _solved(self, book: Book, request: Request) -> Prices:
        formula, may = is_lognormal(book), may_exercise(book)
        shared = request.share_solves and not (request.by_rates and request.greeks != "none")
        found = march_book(book, request, european=may & ~formula, share=shared)
        strike, escrow = book.strike, book.escrow_now()
        settled = found.settled & np.isfinite(found.value)
        columns, complete = by_spot(book, found), settled
        if request.greeks == "none":
            columns = {name: columns[name] for name in ("delta", "gamma")}
        else:
            if request.greeks == "standard":
                del columns["charm"], columns["charm_error"]
            columns |= (
                by_volatility(book, found)
                if shared
                else _by_parameters(book, found, settled & ~found.exercised, request)
            )
            complete = settled & ~np.isnan(columns["vega"])
        european = strike * np.where(may, found.european, found.value)
        rows = np.flatnonzero(formula)
        if rows.size:
            european[rows] = european_columns(book.european().take(rows), "none")["value"]
        interrupted = request.is_interrupted()
        return priced(
            book,
            value=strike * found.value,
            european=european,
            error=np.where(settled, strike * found.error, math.nan),
            boundary=strike * found.boundary + escrow,
            boundary_error=strike * found.boundary_error,
            exercised=found.exercised,
            settled=settled,
            complete=complete,
            method=self.method,
            status=np.where(interrupted & ~complete, "deadline", "ok").astype(object),
            steps=found.steps,
            solves=found.levels,
            **columns,
        )

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return both boundaries from one solve, or a few where they begin far from the strike."""
        from pricing_core.american.engines.obstacle_march.boundaries import BoundariesOf  # noqa: PLC0415

        return BoundariesOf(book, request, self._traces)

    def _traces(self, book: Book, request: Request) -> Traces | None:
        """Return the boundaries over time of a book of one contract, marched around its spot; None without any."""
        from pricing_core.american.engines.obstacle_march.boundaries import Piece, Traces  # noqa: PLC0415

        if not self.serves(book)[0]:
            return None
        found = march_book(book, request, boundaries=True)
        if not found.settled[0]:
            request.end_if_interrupted()
            return None

        def pieces(ends: Matrix) -> tuple[Piece, ...]:
            """Return the boundaries of one grid; what is just before a segment's end comes first of it."""
            made = []
            for k, segment in enumerate(book.segments_of() if ends.size else ()):
                held, *steps = ends[ends[:, 0] == k]
                known = np.array(steps)[:, 1:] if segment.exercisable else np.zeros((0, 4))
                span = segment.start, segment.end
                made.append(
                    Piece.of(book, span, segment.end - known[:, 0], known[:, 1:], tuple(held[2:].tolist()))
                )
            return tuple(made)

        coarse, fine = map(pieces, found.ends(0))
        return Traces(book, fine, coarse)


def least_volatility(book: Book) -> Vector:
    """Return the least volatility that is marched in each segment, at least its own, shape (m,)."""
    segments, first = book.segments, book.first[:-1]
    drift = np.abs(segments.rate - segments.dividend_yield) * segments.duration
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.fmin(segments.fraction + book.drops() / book.per_segment(book.spot), LARGEST_DROP)
        least = np.where(segments.duration > 0.0, drift / LARGEST_DRIFT / np.sqrt(segments.duration), 0.0)
        reached = np.add.reduceat(drift - np.log1p(-share), first) / LARGEST_RANGE
        of_whole = np.where(book.deviation < reached, reached / np.sqrt(book.expiry), 0.0)
    least = np.maximum((1.0 + 1e-9) * np.maximum(least, book.per_segment(of_whole)), LEAST_VOLATILITY)
    raised: Vector = np.maximum(segments.volatility, least)
    return raised


def leaves_out_the_strike(book: Book) -> BoolVector:
    """Tell contracts that may be exercised now and whose grids may reach neither the strike nor a boundary near it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.abs(np.log(book.diffusing() / book.strike))
    far: BoolVector = book.now.exercisable & (away > FURTHEST * book.deviation)
    return far


def _by_parameters(book: Book, found: MarchedSegments, held: BoolVector, request: Request) -> dict[str, Any]:
    """Return the Greeks by the parameters as columns; contracts without a segment for each are marched again with one.

    `held` tells which contracts they are wanted of, shape (n,).
    """
    extended = request.greeks == "extended"
    columns = by_parameters(book, found, extended=extended)
    rows = np.flatnonzero(held & lacks_cuts(book, extended=extended))
    if rows.size:
        cut = with_entries(book.take(rows), extended=extended)
        # Next to nothing more to be paid may be all that an escrow leaves.
        left = np.flatnonzero(cut.diffusing() > 0.0)
        rows, cut = rows[left], cut.take(left)
    if rows.size:
        again = march_book(cut, request.take(rows))
        columns |= stored(columns, rows, by_parameters(cut, again, extended=extended))
    return columns
