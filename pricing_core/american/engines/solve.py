"""From a book to its prices: each contract goes to the first engine that serves it, and on where that is not enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, LISTS, Prices, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.closed_form import ClosedForm, has_boundary_elsewhere
from pricing_core.american.engines.engine import UNRESOLVED, Boundaries, BoundariesAt, Engine, Request
from pricing_core.american.engines.exercise_region import limits_before_expiry
from pricing_core.american.engines.hardly_diffusing import HardlyDiffusing
from pricing_core.american.engines.obstacle_march import (
    CompiledMarch,
    MarchWithoutKernel,
    leaves_out_the_strike,
)
from pricing_core.american.engines.premium_march import PremiumMarch
from pricing_core.american.engines.price_bounds import lies_high, range_of
from pricing_core.arrays import BoolVector, Vector, every, some
from pricing_core.kernel import warn_where_missing

CLOSED_FORM, PREMIUM_MARCH, COMPILED_MARCH = ClosedForm(), PremiumMarch(), CompiledMarch()
# Those whose vega costs no more than a few prices: the search for a volatility asks them first.
FAST_ENGINES: tuple[Engine, ...] = (CLOSED_FORM, PREMIUM_MARCH, COMPILED_MARCH)
ENGINES: tuple[Engine, ...] = (*FAST_ENGINES, HardlyDiffusing(), MarchWithoutKernel())
BOUNDS_ALONE = "of the price its bounds without arbitrage are known alone, between which it stands"


def solve(book: Book, request: Request, *, engines: Sequence[Engine] = ENGINES) -> Prices:
    """Price a book.

    A contract that an engine does not settle, or whose error estimate misses the tolerance, goes on to the next
    engine that serves it; of two prices the one with the smaller error estimate counts, and Greeks that it lacks are
    taken from the other; a price that meets its tolerance stays, so that it does not depend on the Greeks asked for.

    Parameters
    ----------
    book : Book
    request : Request
    engines : sequence of Engine
        The engines, in the order in which they are asked.
    """
    warn_where_missing()
    if book.reduction is not None:  # whose discount may be above 1
        largest = np.maximum(book.reduction.discount, 1.0)
        request = replace(request, tolerance=request.tolerance / largest)
    request = _asking_once(request)
    return _completed(book, _solved(book, request, engines), request, engines)


def _solved(book: Book, request: Request, engines: Sequence[Engine]) -> Prices:
    """Return what the engines find, within the bounds of no arbitrage."""
    best: Prices | None = None
    allowed = request.tolerance * book.strike  # money
    rows, part, wanted = np.arange(book.count), book, request
    interrupted = False
    for engine in engines:
        interrupted = rows.size > 0 and request.is_interrupted()
        if rows.size == 0 or interrupted:
            break
        served = engine.serves(part)
        if best is not None:
            served = served & _is_worthwhile(engine, best.take(rows), part)
        if every(served):
            found = engine.solve(part, wanted)
        elif some(served):
            places = np.flatnonzero(served)
            found = engine.solve(part.take(places), wanted.take(places))
            rows = rows[places]
        else:
            continue
        best = _together(best, book.count, rows, found, allowed)
        done = best.settled & best.complete & (best.error <= allowed)
        if every(done):
            return _within_bounds(book, best, allowed)
        rows = np.flatnonzero(~(done | (best.status != "ok")))
        part, wanted = book.take(rows), request.take(rows)
    if best is None:
        best = prices(book.count)
    if engines is ENGINES and not interrupted:  # who chooses an engine is told that it fails
        best = _bounds_of_the_lost(book, best)
    best = _within_bounds(book, best, allowed)
    return _with_status(best, allowed, interrupted=interrupted)


def _asking_once(request: Request) -> Request:
    """Return the request with True as the answer of its interrupt once it has been true, whoever asks next."""
    interrupt, ended = request.interrupt, False
    if interrupt is None:
        return request

    def asked() -> bool:
        nonlocal ended
        ended = ended or interrupt()
        return ended

    return replace(request, interrupt=asked)


def boundary_of(book: Book, request: Request, engines: Sequence[Engine] = ENGINES) -> BoundariesAt:
    """Return the exercise boundary of a book of one contract, at each time from the first engine that finds it.

    The function that is returned raises `NumericalError` where the interrupt came before the end.
    """
    warn_where_missing()
    request = _asking_once(request)
    asked = [engine.boundary(book, request) for engine in engines if engine.serves(book)[0]]
    return lambda times: _boundaries_at(book, times, asked)


def _boundaries_at(book: Book, times: Vector, asked: list[BoundariesAt]) -> Boundaries:
    nothing = np.full(times.size, np.nan)
    best = Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
    for boundary in asked:
        if not every(best.found):
            best = best.completed_by(boundary(times))
    best = best._replace(near=_where_exercise_pays(book, best.near))
    if not book.is_plain or book.is_local()[0]:
        return best
    # Without events the exercise region grows towards the expiry (Jaillet, Lamberton, Lapeyre 1990).
    inwards, outwards = (np.fmin, np.fmax) if book.is_put[0] else (np.fmax, np.fmin)
    near, far = (
        np.where(np.isnan(end), end, running.accumulate(end[::-1])[::-1])
        for end, running in ((best.near, inwards), (best.far, outwards))
    )
    return best._replace(near=near, far=far)


def _where_exercise_pays(book: Book, boundary: Vector) -> Vector:
    """Return boundaries, money, with those at the strike that lie where exercise brings nothing."""
    beyond = book.sign * (boundary - book.strike) > 0.0
    return np.where(beyond, book.strike, boundary) if some(beyond) else boundary


def _is_worthwhile(engine: Engine, before: Prices, book: Book) -> BoolVector:
    """Tell which contracts may gain from an engine, given what others found of them."""
    rough = ~(before.error <= engine.least_error * book.strike)
    return rough | ~before.settled | ~before.complete


def _together(best: Prices | None, count: int, rows: Rows, found: Prices, allowed: Vector) -> Prices:
    """Return the prices so far with those that were found, where these were wanted and their errors are smaller.

    A price whose error is at most `allowed`, money, shape (count,), was asked for Greeks alone: it stays.
    """
    if best is None:
        return prices(count).replaced(rows, found) if rows.size < count else found
    before = best.take(rows)
    keep = (before.error <= found.error) | (np.isnan(found.error) & ~np.isnan(before.error))
    keep |= before.settled & (before.error <= allowed[rows])
    kept = np.flatnonzero(keep)
    if kept.size == 0:
        return best.replaced(rows, found)
    lacking = kept[~before.complete[kept] & found.complete[kept]]
    columns: dict[str, Any] = {}
    for name in GREEKS:
        absent = lacking[np.isnan(getattr(before, name)[lacking])]
        for column in (name, error_of(name)):
            columns[column] = getattr(before, column).copy()
            columns[column][absent] = getattr(found, column)[absent]
    for name in LISTS:
        columns[name] = getattr(before, name).replaced(lacking, getattr(found, name).take(lacking))
    complete, settled = before.complete.copy(), before.settled | found.settled
    complete[lacking] = True
    filled = replace(before, **columns, complete=complete, settled=settled)
    return best.replaced(rows, found.replaced(kept, filled.take(kept)))


def _within_bounds(book: Book, best: Prices, allowed: Vector) -> Prices:
    """Return the prices with none outside the bounds of no arbitrage.

    An error that misses the tolerance and is as large as the range between these bounds says nothing, nor does one that
    is unknown: then the middle of the range is the price, and half the range its error.
    """
    known = ~np.isnan(best.value)
    rows = np.flatnonzero(known & (~(best.error <= allowed) | lies_high(book, best.value)))
    if rows.size == 0:
        return best
    found, part = best.take(rows), book.take(rows)
    least, most = range_of(part)
    lost = ~(found.error <= allowed[rows]) & ~(found.error < most - least) & np.isfinite(most - least)
    inside = replace(found, value=np.clip(found.value, least, most))
    bounds = _middle(least[lost], most[lost])
    return best.replaced(rows, inside.replaced(np.flatnonzero(lost), bounds))


def _bounds_of_the_lost(book: Book, best: Prices) -> Prices:
    """Return the prices with the middle of the bounds where every engine failed, and in the message why."""
    rows = np.flatnonzero((best.status == "out_of_domain") | ((best.status == "ok") & np.isnan(best.value)))
    if rows.size == 0:
        return best
    least, most = range_of(book.take(rows))
    known = np.isfinite(most - least)
    rows, bounds = rows[known], _middle(least[known], most[known])
    reasons = np.where(best.message[rows] == "", UNRESOLVED, best.message[rows])
    return best.replaced(rows, replace(bounds, message=bounds.message + ": " + reasons))


def _middle(least: Vector, most: Vector) -> Prices:
    half = 0.5 * (most - least)
    return prices(half.size, value=least + half, error=half, method="none", message=BOUNDS_ALONE)


def _with_status(best: Prices, allowed: Vector, *, interrupted: bool) -> Prices:
    """Return the prices with the status of every row that no engine ended; `allowed` is the tolerance in money."""
    status, answered = best.status.copy(), best.status == "ok"
    status[answered & ~(best.error <= allowed)] = "deadline" if interrupted else "tolerance_not_met"
    status[answered & np.isnan(best.value)] = "deadline" if interrupted else "out_of_domain"
    return replace(best, status=status)


def _completed(book: Book, best: Prices, request: Request, engines: Sequence[Engine]) -> Prices:
    """Return the prices of the contracts as they are stated, with what needs no engine."""
    boundary = _where_exercise_pays(book, best.boundary)
    best = best if boundary is best.boundary else replace(best, boundary=boundary)
    found = _with_greeks_of_payoffs(book, _with_boundaries(book, best, request, engines), request)
    return found if book.reduction is None else book.reduction.stated(found, book.listed.dividend_yield)


def _with_greeks_of_payoffs(book: Book, best: Prices, request: Request) -> Prices:
    """Return the prices without charm, and without errors of Greeks, where a contract is exercised or has expired.

    The Greeks are the payoff's there. At the strike it has no delta at expiry: there the errors stay unknown, and those
    of a spot that is nearer to the boundary than that is known are the engine's.
    """
    if request.greeks == "none":
        return best
    expired = book.expiry == 0.0
    if not some(best.exercised | expired):
        return best
    exercised = best.exercised & ~(np.abs(book.spot - best.boundary) <= best.boundary_error)
    columns: dict[str, Any] = {}
    if request.greeks == "extended":
        columns["charm"] = np.where(best.exercised | expired, 0.0, best.charm)
    sure = exercised | (expired & (best.exercised | (book.spot != book.strike)))
    for name in GREEKS:
        known = sure & ~np.isnan(columns.get(name, getattr(best, name)))
        columns[error_of(name)] = np.where(known, 0.0, getattr(best, error_of(name)))
    rows = np.flatnonzero(sure)
    for name in GREEK_LISTS:
        there = getattr(best, name).take(rows)
        no_error = Ragged(there.first, np.zeros(there.values.size))
        columns[error_of(name)] = getattr(best, error_of(name)).replaced(rows, no_error)
    return replace(best, **columns)


def _with_boundaries(book: Book, best: Prices, request: Request, engines: Sequence[Engine]) -> Prices:
    """Return the prices with the exercise boundaries of contracts whose spot tells nothing of them."""
    unknown = best.settled & np.isnan(best.boundary)
    if not some(unknown):
        return best
    elsewhere = (best.method == COMPILED_MARCH.method) & leaves_out_the_strike(book)
    rows = np.flatnonzero(unknown & (has_boundary_elsewhere(book) | elsewhere))
    if rows.size == 0:
        return best
    part = replace(book.take(rows), reduction=None)
    asked = replace(request.take(rows), greeks="none", share_solves=False)
    near, error_of_near = np.full((2, rows.size), math.nan)
    for spot in (part.strike, limits_before_expiry(part)):
        missing = np.flatnonzero(np.isnan(near) & ~np.isnan(spot))
        if missing.size:
            there = part.take(missing).diffusing_at(spot[missing])
            found = _solved(there, asked.take(missing), engines)
            near[missing], error_of_near[missing] = found.boundary, found.boundary_error
    boundary, error = best.boundary.copy(), best.boundary_error.copy()
    boundary[rows], error[rows] = near, error_of_near
    return replace(best, boundary=boundary, boundary_error=error)
