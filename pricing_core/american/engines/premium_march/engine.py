"""The engine of the premium's march: contracts as dimensionless puts, and what the march finds in money."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import CURVES, Book, Rows
from pricing_core.american.book.prices import Prices, error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.tolerances import BOUNDARY_ACCURACY
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, PARALLEL, of_dividends_not_due
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.held import priced
from pricing_core.american.engines.premium_march.puts import Puts, PutValues, solve_boundaries, solve_puts
from pricing_core.arrays import BoolVector, Matrix, Vector

GREEKS_SHARE = 10.0  # Error allowed to Greeks, in tolerances; chosen.
ROUNDING = 1e-14  # Rounding error of a marched value, in strikes of its put; measured.
SMALLEST_SPREAD = 1e-7  # Smallest standard deviation of ln S at expiry that the kernel marches.
SPREAD_STEP = 0.002  # Step of the difference for volga as a share of the volatility; calibrated.
# Errors of the derivatives by x, once and twice, rate, yield and spread: shares of their changes from one march to the
# next, and of the value's error over the spread (ONCE) or its square (TWICE); calibrated on random puts.
CHANGE_SHARES = np.array([[0.5], [0.5], [0.8], [0.8], [0.5]])
VALUE_SHARES = np.array([[0.4], [0.6], [1.5], [1.5], [0.5]])
ONCE, TWICE = slice(0, 5, 4), slice(1, 4)
# The same for vanna and charm, and for volga; calibrated.
CROSS_SHARE, VANNA_VALUE_SHARE, CHARM_VALUE_SHARE = 0.5, 1.0, 0.4
VOLGA_SHARE, VOLGA_VALUE_SHARE = 0.5, 1.0


class PremiumMarch:
    """One segment, one exercise boundary."""

    name = "premium march"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell American contracts without events and with a positive volatility; the kernel may still give them up."""
        if kernel.solve_puts is None:
            return np.zeros(book.count, dtype=bool)
        now = book.first_segments()
        served = now.exercisable & (now.volatility * np.sqrt(now.end) >= SMALLEST_SPREAD) & (book.spot > 0.0)
        served &= ~book.is_local()
        return served if book.is_plain else served & ~book.has_events()

    def solve(self, book: Book, request: Request) -> Prices:
        """March the premiums of all contracts."""
        with np.errstate(all="ignore"):
            return _march(book, request)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return the boundary of marches to each of the times, refined until two agree."""
        schedule, nothing = book.schedule(0), np.full(times.size, math.nan)
        limit, far = region_at_expiry(schedule).boundaries(schedule)
        if not math.isnan(far):
            return Boundaries(nothing, nothing, nothing, np.zeros(times.size, dtype=bool))
        tau = np.maximum(book.expiry[0] - times, 0.0)
        later = np.flatnonzero(tau > 0.0)
        near, error, found = np.full(tau.size, limit), np.zeros(tau.size), np.ones(tau.size, dtype=bool)
        puts = _as_puts(_with_lives(book.take(np.zeros(later.size, dtype=np.intp)), tau[later]))
        accuracy = BOUNDARY_ACCURACY * math.sqrt(request.tolerance[0])
        places, relative, found[later] = solve_boundaries(puts, accuracy, request.interrupt)
        with np.errstate(over="ignore"):  # in those that were not found
            near[later] = schedule.strike * np.exp(places if schedule.is_put else -places)
        error[later] = relative * near[later]
        return Boundaries(near, nothing, error, found)


def _with_lives(book: Book, years: Vector) -> Book:
    """Return the contracts with these lives."""
    return replace(book, segments=replace(book.segments, end=years))


def _as_puts(book: Book) -> Puts:
    """Return the puts: a call is one with spot and strike, and rate and yield, exchanged."""
    segments, expiry = book.segments, book.segments.end
    x = np.log(book.spot / book.strike)
    return Puts(
        np.where(book.is_put, x, -x),
        np.where(book.is_put, segments.rate, segments.dividend_yield) * expiry,
        np.where(book.is_put, segments.dividend_yield, segments.rate) * expiry,
        segments.volatility * np.sqrt(expiry),
    )


def _march(book: Book, request: Request) -> Prices:
    puts = _as_puts(book)
    scale = np.where(book.is_put, book.strike, book.spot)
    # A spot that even the option without expiry would be exercised at needs the boundary alone.
    certain = puts.x < 0.0
    if certain.any():
        certain &= puts.x <= -np.log1p(puts.spread / puts.decay())
    tolerance = request.tolerance * np.where(book.is_put | certain, 1.0, book.strike / scale)
    limits = None if request.greeks == "none" else _limits(book, request.tolerance, scale)
    solved = solve_puts(
        puts,
        tolerance,
        limits=limits,
        spread_step=SPREAD_STEP if request.greeks == "extended" else None,
        threads=request.threads,
        shared=request.share_solves,
        interrupt=request.interrupt,
    )
    return _in_money(book, scale, solved, request.greeks)


def _limits(book: Book, tolerance: Vector, scale: Vector) -> Matrix:
    """Return what the dimensionless values may be off by for Greeks to ten tolerances.

    Delta, and theta, vega and the rhos over the strike; strike times gamma to a thousand tolerances.
    """
    allowed = GREEKS_SHARE * tolerance * book.strike / scale
    moneyness, expiry = book.spot / book.strike, book.segments.end
    by_spot = allowed * moneyness  # delta = K/S v_x or v - v_x; its scale is 1, not the strike
    curvature = np.minimum(2.0 * allowed / book.segments.volatility**2, 100.0 * allowed * moneyness**2)
    limits = np.full((scale.size, 7), np.inf)
    limits[:, 1], limits[:, 2] = by_spot, curvature
    limits[:, 4] = limits[:, 5] = allowed / expiry
    limits[:, 6] = allowed / np.sqrt(expiry)
    return limits


def _in_money(book: Book, scale: Vector, solved: PutValues, greeks: Greeks) -> Prices:
    """Return money for the puts' dimensionless values; a call is S times the put with spot and strike exchanged."""
    is_put, spot, expiry, settled = book.is_put, book.spot, book.segments.end, solved.settled
    known = scale if settled.all() else np.where(settled, scale, math.nan)
    value, by_x, by_xx, european = known * solved.values[:4]
    columns: dict[str, Any] = {"complete": True}
    if greeks != "none":
        columns |= _errors(book, scale, solved)
        columns[DIVIDENDS] = of_dividends_not_due(book)
        by_rate, by_dividend, by_spread = known * solved.values[4:]
        columns["vega"] = np.sqrt(expiry) * by_spread
        columns["rho"] = expiry * np.where(is_put, by_rate, by_dividend)
        columns["dividend_rho"] = expiry * np.where(is_put, by_dividend, by_rate)
    if greeks == "extended":
        columns |= _second_order(book, scale, solved) | _buckets(book, columns)
    return priced(
        book,
        value=value,
        european=european,
        error=known * (solved.error + ROUNDING * ~solved.exercised),
        delta=np.where(is_put, by_x, value - by_x) / spot,
        gamma=(by_xx - by_x) / spot / spot,
        boundary=book.strike * np.exp(np.where(is_put, solved.boundary, -solved.boundary)),
        exercised=solved.exercised,
        settled=settled,
        method="premium-march",
        solves=1,
        steps=solved.steps,
        **columns,
    )


def _errors(book: Book, scale: Vector, solved: PutValues) -> dict[str, Vector]:
    """Return the error estimates of the Greeks that the marches give, money."""
    is_put, spot, expiry = book.is_put, book.spot, book.segments.end
    by_spread_once = 1.0 / (book.segments.volatility * np.sqrt(expiry))
    value = scale * (solved.error + ROUNDING)
    once = value * by_spread_once
    errors = CHANGE_SHARES * scale * np.abs(solved.changes)
    errors[ONCE] += VALUE_SHARES[ONCE] * once
    errors[TWICE] += VALUE_SHARES[TWICE] * (once * by_spread_once)
    by_x, by_xx, by_rate, by_dividend, by_spread = errors
    return {
        error_of("delta"): np.where(is_put, by_x, value + by_x) / spot,
        error_of("gamma"): (by_xx + by_x) / spot / spot,
        error_of("vega"): np.sqrt(expiry) * by_spread,
        error_of("rho"): expiry * np.where(is_put, by_rate, by_dividend),
        error_of("dividend_rho"): expiry * np.where(is_put, by_dividend, by_rate),
    }


def _second_order(book: Book, scale: Vector, solved: PutValues) -> dict[str, Vector]:
    """Return vanna, volga and charm, money, and their errors; zero where a contract is exercised.

    A call's delta is v - v_x, v being the put with spot and strike exchanged, and x its ln(K/S).
    """
    expiry, spread = book.segments.end, book.segments.volatility * np.sqrt(book.segments.end)
    root, aging, value = np.sqrt(expiry), _aging(book), solved.error + ROUNDING

    def of_delta(weights: Matrix, by: Matrix, by_x: Matrix) -> Vector:
        total: Vector = np.sum(weights * np.where(book.is_put, by_x, by - by_x), axis=0)
        return total / book.spot

    by_spread = np.stack([0.0 * root, 0.0 * root, root])
    over_spread, over_square = value / spread, value / spread**2
    columns = {
        "vanna": of_delta(by_spread, solved.values[4:], solved.seconds[:3]),
        "volga": expiry * solved.seconds[3],
        "charm": -of_delta(aging, solved.values[4:], solved.seconds[:3]),
        error_of("vanna"): CROSS_SHARE
        * np.abs(of_delta(by_spread, solved.changes[2:], solved.second_changes[:3]))
        + VANNA_VALUE_SHARE * root * over_square / book.spot,
        error_of("volga"): expiry * VOLGA_SHARE * np.abs(solved.second_changes[3])
        + expiry * (VOLGA_VALUE_SHARE * over_square + ROUNDING / (SPREAD_STEP * spread) ** 2),
        error_of("charm"): CROSS_SHARE
        * np.abs(of_delta(aging, solved.changes[2:], solved.second_changes[:3]))
        + CHARM_VALUE_SHARE * over_spread / (expiry * book.spot),
    }
    known = np.where(solved.settled, scale, math.nan)
    return {name: np.where(solved.exercised, 0.0, known * column) for name, column in columns.items()}


def _aging(book: Book) -> Matrix:
    """Return how fast r T, q T and sigma sqrt(T) of the put grow with the time to expiry, shape (3, n)."""
    segments, is_put = book.segments, book.is_put
    return np.stack(
        [
            np.where(is_put, segments.rate, segments.dividend_yield),
            np.where(is_put, segments.dividend_yield, segments.rate),
            0.5 * segments.volatility / np.sqrt(segments.end),
        ]
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
