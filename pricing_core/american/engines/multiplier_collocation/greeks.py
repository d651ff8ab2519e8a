"""Greeks from the kernel's derivatives by the numbers of every segment, with error estimates.

The kernel differentiates value and slope by rate, yield, volatility, dividend and escrow of each segment (the adjoint
of its recursion). A Greek is a sum of these: over all segments, over those of one piece of a curve, or the one that a
dividend ends.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import CURVES, Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.schedule import SAME_TIME
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, PARALLEL
from pricing_core.american.engines.multiplier_collocation.levels import Solved
from pricing_core.arrays import BoolVector, Vector

# The numbers of a segment by which the kernel differentiates, in its order, and what exercise on it contributes.
NUMBERS = ("rate", "dividend_yield", "volatility", "amount", "escrow", "exercise")
RATE, _, VOLATILITY, AMOUNT, ESCROW, EXERCISE = range(len(NUMBERS))
# Amount of a dividend, in strikes, that changes no value by more than a billionth; chosen.
NEXT_TO_NOTHING = 1e-9
OWN, CHANGE = range(2)  # The derivatives, and their changes with the degrees of the boundaries.
# Error of each derivative over the sum of its changes with the degrees, and over the value's error (times the years for
# those by rate, yield and volatility), for two degrees may agree by accident; calibrated on random contracts, as is all
# that follows.
CHANGE_SHARES = np.array([1.7, 1.8, 1.6, 2.6, 2.6, 0.64])
VALUE_SHARES = np.array([0.8, 1.2, 1.6, 2.6])
# The same of a derivative by one piece of a curve, with the years over the standard deviation of ln S.
PIECE_CHANGE_SHARE, PIECE_VALUE_SHARE = 2.0, 0.04
# The same of the slope, of the second derivative by x (with the years over the variance) and of vanna.
SLOPE_VALUE_SHARE, GAMMA_SHARE, GAMMA_VALUE_SHARE, VANNA_SHARE, VANNA_VALUE_SHARE = 0.32, 1.6, 0.3, 1.5, 7.5
# Errors that the panels leave at each level, in strikes: of a derivative by a parameter, per 1.00 and year, and of the
# slope, in standard deviations of ln S; measured.
BY_PANELS = np.array([1e-4, 4e-6, 1e-9, 4e-11, 4e-11, 4e-11, 4e-11])
SLOPE_BY_PANELS = np.array([1e-4, 2e-6, 1e-10, 2e-11, 2e-11, 2e-11, 2e-11])
# Error of charm over the change of the first segment's derivatives, over that of the slope in variances of ln S, and
# over what the panels leave of the slope in variances over the first segment; calibrated.
CHARM_BY_FIRST, CHARM_BY_SLOPE, CHARM_BY_PANELS = 0.57, 0.75, 3.0
# What the panels leave of a further derivative by x over what they leave of the one before, in the same unit.
PANEL_ROUGHNESS = 20.0
Derivatives = NDArray[np.float64]  # (m, 2, 2, 6), or a part of it
Columns = dict[str, Any]


def greeks_of(book: Book, solved: Solved, *, extended: bool) -> Columns:
    """Return the Greeks that the solution gave, and their errors, as columns of `Prices`; volga is not among them.

    Parameters
    ----------
    book : Book
        Every entry of its curves and dividends by which there is a derivative is at the end of a segment
        (`lacks_cuts`).
    extended : bool
        Whether vanna, charm and the buckets are wanted as well.
    """
    gradient = _through_escrow(book, solved) if book.escrowed.any() else solved.gradient
    K, starts = book.strike, book.first[:-1]
    S = book.spot - book.escrow_now()
    total = np.add.reduceat(gradient, starts, axis=0)
    change, error = total[:, CHANGE], CHANGE_SHARES * total[:, CHANGE, 0]
    deviation = np.sqrt(np.add.reduceat(book.segments.volatility**2 * book.segments.duration, starts))
    by_panels = BY_PANELS[solved.level] * (1.0 + book.expiry)
    by_value = solved.error * book.expiry / deviation
    error[:, :AMOUNT] += (solved.error * book.expiry)[:, None] * VALUE_SHARES[:AMOUNT]
    left = SLOPE_BY_PANELS[solved.level] / deviation
    by_slope = CHANGE_SHARES[EXERCISE] * change[:, 1, EXERCISE] + SLOPE_VALUE_SHARE * by_value + left
    by_curvature = GAMMA_SHARE * change[:, 1, EXERCISE] + GAMMA_VALUE_SHARE * by_value
    by_curvature = (by_curvature + PANEL_ROUGHNESS * left) / deviation
    columns: Columns = by_spot(book, solved) | {
        error_of("delta"): K / S * by_slope,
        error_of("gamma"): K / S**2 * (by_slope + by_curvature),
    }
    for name, greek in PARALLEL.items():
        k = NUMBERS.index(name)
        columns[greek] = K * total[:, OWN, 0, k]
        columns[error_of(greek)] = K * (error[:, k] + by_panels)
    columns |= _by_dividends(book, gradient, by_panels + VALUE_SHARES[AMOUNT] * solved.error)
    if extended:
        columns["vanna"] = K / S * total[:, OWN, 1, VOLATILITY]
        slope_by_panels = PANEL_ROUGHNESS * by_panels / deviation
        columns[error_of("vanna")] = (
            K / S * (VANNA_SHARE * change[:, 1, VOLATILITY] + VANNA_VALUE_SHARE * by_value + slope_by_panels)
        )
        columns |= _charm(book, solved, S, change[:, 1, EXERCISE] / deviation**2)
        for name in CURVES:
            columns |= _by_pieces(book, name, gradient, by_panels + PIECE_VALUE_SHARE * by_value)
    return columns


def by_spot(book: Book, solved: Solved) -> Columns:
    """Return delta and gamma as columns of `Prices`."""
    K, S = book.strike, book.spot - book.escrow_now()
    return {"delta": K / S * solved.slope, "gamma": K / S * ((solved.curvature - solved.slope) / S)}


def lacks_cuts(book: Book, *, extended: bool) -> BoolVector:
    """Tell contracts with an entry by which there is a derivative, but no segment that ends there, shape (n,)."""
    lacking = np.zeros(book.count, dtype=bool)
    for listed in _entries(book, extended=extended):
        if listed.values.size:
            owner, time = listed.owner(), listed.values
            expiry = book.expiry[owner]
            before = (time > SAME_TIME * expiry) & (time < expiry * (1.0 - SAME_TIME))
            _, ends_there = _segment_at(book, owner, time)
            lacking[owner[before & ~ends_there]] = True
    return lacking


def with_entries(book: Book, *, extended: bool) -> Book:
    """Return the contracts with a segment ending at every entry by which there is a derivative.

    A dividend of nothing becomes one of next to nothing: the derivative by its amount is that from above.
    """
    listed = _entries(book, extended=extended)
    times = [sum((each.row(row) for each in listed), ()) for row in range(book.count)]
    cut = with_cuts(book, Ragged.of(times))
    dividends = cut.listed.cash_dividends
    segment, ends_there = _segment_at(cut, dividends.owner(), dividends.values)
    due, chosen = cut.segments.due.copy(), segment[ends_there & (dividends.values > 0.0)]
    due[chosen] = np.maximum(due[chosen], NEXT_TO_NOTHING * cut.per_segment(cut.strike)[chosen])
    return replace(cut, segments=replace(cut.segments, due=due))


def _entries(book: Book, *, extended: bool) -> list[Ragged]:
    """Return the times of dividends and, if wanted, of curves: of all entries by which there is a derivative."""
    return [getattr(book.listed, name) for name in ("cash_dividends", *(CURVES if extended else ()))]


def _charm(book: Book, solved: Solved, S: Vector, by_slope: Vector) -> Columns:
    """Return d delta/dt in calendar time, 1/year, and its error.

    A segment that is longer by a share is one with variance, rate and yield larger by that share. So the derivatives
    by the first segment's numbers give that by its duration; an escrow grows with the rate besides. `by_slope` is how
    far the slope changes with the degrees of the boundaries, over the variance of ln S.
    """
    now, first = book.first_segments(), solved.gradient[book.first[:-1], :, 1, :AMOUNT]
    per_year = np.stack([now.rate, now.dividend_yield, 0.5 * now.volatility], axis=1) / now.duration[:, None]
    charm = -(first[:, OWN] * per_year).sum(axis=1) * book.strike / S
    charm -= now.rate * book.escrow_now() * by_spot(book, solved)["gamma"]
    changes = CHARM_BY_FIRST * (first[:, CHANGE] * np.abs(per_year)).sum(axis=1)
    spread = now.volatility * np.sqrt(now.duration)
    elsewhere = CHARM_BY_SLOPE * by_slope + CHARM_BY_PANELS * SLOPE_BY_PANELS[solved.level] / spread**3
    error = book.strike / S * (changes + 0.5 * now.volatility**2 * elsewhere)
    return {"charm": charm, error_of("charm"): error}


def _through_escrow(book: Book, solved: Solved) -> Derivatives:
    """Return the derivatives with the escrow's own dependence on rates and dividends taken into those by these.

    In the escrowed model the spot that diffuses, and the strike at every time, are less by what the dividends due are
    worth.
    """
    gradient, segments, strike = solved.gradient.copy(), book.segments, book.per_segment(book.strike)
    discount = np.exp(-segments.rate * segments.duration)
    escrow = book.escrow() / strike
    fall = (segments.duration * discount * escrow)[:, None]  # of what the escrow is worth, by the rate
    S = (book.spot - book.escrow_now()) / book.strike
    by_escrow = np.zeros((book.count, 2, 2))
    by_escrow[:, OWN] = -np.stack([solved.slope, solved.curvature], axis=1) / S[:, None]
    for places, everywhere in book.by_place():
        rows, at = places[book.escrowed[places]], everywhere[book.escrowed[places]]
        gradient[at, OWN, :, RATE] -= fall[at] * by_escrow[rows, OWN]
        gradient[at, CHANGE, :, RATE] += fall[at] * by_escrow[rows, CHANGE]  # changes are absolute
        by_escrow[rows] = discount[at, None, None] * by_escrow[rows] + solved.gradient[at, :, :, ESCROW]
        gradient[at, :, :, AMOUNT] = by_escrow[rows]
    return gradient


def _by_dividends(book: Book, gradient: Derivatives, left_out: Vector) -> dict[str, Ragged]:
    """Return the derivative by each cash dividend, 0 for those not due; `left_out` is what the changes do not show."""
    listed = book.listed.cash_dividends
    value, error = np.zeros((2, listed.values.size))
    if listed.values.size:
        owner, time, expiry = listed.owner(), listed.values, book.expiry[listed.owner()]
        segment, ends_there = _segment_at(book, owner, time)
        due = np.flatnonzero((time > SAME_TIME * expiry) & ends_there)
        value[due] = gradient[segment[due], OWN, 0, AMOUNT]
        changes = gradient[segment[due], CHANGE, 0, AMOUNT]
        error[due] = CHANGE_SHARES[AMOUNT] * changes + left_out[owner[due]]
    return {DIVIDENDS: Ragged(listed.first, value), error_of(DIVIDENDS): Ragged(listed.first, error)}


def _by_pieces(book: Book, name: str, gradient: Derivatives, left_out: Vector) -> dict[str, Ragged]:
    """Return the derivative by each value of a curve: the sum over the segments in its piece."""
    listed, k = getattr(book.listed, name), NUMBERS.index(name)
    value, error = np.zeros((2, listed.values.size))
    if listed.values.size:
        owner = np.repeat(np.arange(book.count), np.diff(book.first))
        chosen = np.flatnonzero(listed.counts()[owner] > 0)
        segments, owner = book.segments.take(chosen), owner[chosen]
        middle = _keys(book, owner, 0.5 * (segments.start + segments.end))
        ends = _keys(book, listed.owner(), listed.values)
        piece = np.minimum(np.searchsorted(ends, middle), listed.first[owner + 1] - 1)
        strike = book.strike[owner]
        value += np.bincount(piece, strike * gradient[chosen, OWN, 0, k], value.size)
        change = strike * PIECE_CHANGE_SHARE * gradient[chosen, CHANGE, 0, k]
        error += np.bincount(piece, change, error.size) + (book.strike * left_out)[listed.owner()]
    return {BUCKETS[name]: Ragged(listed.first, value), error_of(BUCKETS[name]): Ragged(listed.first, error)}


def _segment_at(book: Book, owner: NDArray[np.int64], time: Vector) -> tuple[NDArray[np.int64], BoolVector]:
    """Return the segment whose end is nearest to each time of the contracts `owner`, and whether it ends there."""
    owners = np.repeat(np.arange(book.count), np.diff(book.first))
    keys = _keys(book, owners, book.segments.end)
    after = np.searchsorted(keys, _keys(book, owner, time))
    near = np.clip(
        after[:, None] + np.array([-1, 0, 1]), book.first[owner, None], book.first[owner + 1, None] - 1
    )
    distance = np.abs(book.segments.end[near] - time[:, None])
    best = np.argmin(distance, axis=1)
    each = np.arange(owner.size)
    return near[each, best], distance[each, best] <= SAME_TIME * book.expiry[owner]


def _keys(book: Book, owner: NDArray[np.int64], time: Vector) -> Vector:
    """Return numbers that are in order of the contracts, and of the times of each of them."""
    keys: Vector = owner + 0.5 * np.clip(time / book.expiry[owner], 0.0, 1.5)
    return keys
