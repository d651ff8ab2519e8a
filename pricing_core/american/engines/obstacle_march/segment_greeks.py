"""Greeks from the march's derivatives by the numbers of every segment, with error estimates.

A Greek is a sum of these: over all segments, over those of one piece of a curve, or the one that a dividend ends. Its
error is told by how much it changes from the last grid but one to the last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import CURVES, Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.book.segments import SAME_TIME
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, PARALLEL, STICKY
from pricing_core.arrays import BoolVector, Vector

if TYPE_CHECKING:
    from pricing_core._kernels import MarchedSegments

# The numbers of a segment by which the march differentiates, in its order: those of the curves, the share of the spot
# by which it drops, these, and a shift of the local volatility in ln S.
RATE, AMOUNT, ESCROW, SHIFT = CURVES.index("rate"), 4, 5, 6
# The derivatives at the spot, in its order.
BY_X, BY_X_TWICE, RATE_OF_CHANGE, RATE_BY_X, VOLATILITY_AND_X, VOLATILITY_TWICE, VOLATILITY, JUMP = range(8)
# Amount of a dividend, in strikes, that changes no value by more than a billionth; chosen.
NEXT_TO_NOTHING = 1e-9
# The error of a Greek by a parameter over its change, and over what the changes of the derivatives by x tell of it: a
# change at one place may vanish by chance. 99.5 % of random contracts hold; calibrated.
CHANGE_SHARE, FLAT_SHARE = 1.5, 2.0
# How far ln of the boundary moves with the standard deviation of ln S at expiry, at most; measured on random contracts.
BOUNDARY_SPEED = 2.3
BY_RATES, BY_VOLATILITY, BY_DIVIDEND, OF_VANNA, OF_VOLGA = 6.0, 1.0, 5.0, 2.5, 120.0
Columns = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class _Changing:
    """Derivatives and by how much they change between grids; by the numbers of m segments (m, 7) each."""

    value: NDArray[np.float64]
    change: NDArray[np.float64]


def by_spot(book: Book, found: MarchedSegments) -> Columns:
    """Return delta, gamma, theta and charm, with their errors, as columns of `Prices`.

    In the escrowed model V(t, S) = F(t, S - A(t)), with A' = r A what the dividends due are worth. Where the spot may
    as well lie on the boundary's other side, gamma and charm may be off by their jumps.
    """
    spot = book.diffusing() / book.strike
    grown = book.now.rate * book.escrow_now()
    value, change = found.local, found.local_change
    delta, delta_error = value[:, BY_X] / spot, change[:, BY_X] / spot
    square = spot * spot * book.strike
    gamma = (value[:, BY_X_TWICE] - value[:, BY_X]) / square
    gamma_error = (change[:, BY_X_TWICE] + change[:, BY_X] + value[:, JUMP]) / square
    rate_jump = 0.5 * BOUNDARY_SPEED * value[:, JUMP] * book.deviation / book.expiry
    return {
        "delta": delta,
        "delta_error": delta_error,
        "gamma": gamma,
        "gamma_error": gamma_error,
        "theta": -book.strike * value[:, RATE_OF_CHANGE] - grown * delta,
        "theta_error": book.strike * change[:, RATE_OF_CHANGE] + np.abs(grown) * delta_error,
        "charm": -value[:, RATE_BY_X] / spot - grown * gamma,
        "charm_error": (change[:, RATE_BY_X] + rate_jump) / spot + np.abs(grown) * gamma_error,
    }


def by_volatility(book: Book, found: MarchedSegments) -> Columns:
    """Return vega and its error as columns of `Prices`, of contracts that share a march."""
    change = np.maximum(CHANGE_SHARE * found.local_change[:, VOLATILITY], _least_by_volatility(book, found))
    return {"vega": book.strike * found.local[:, VOLATILITY], "vega_error": book.strike * change}


def _least_by_volatility(book: Book, found: MarchedSegments) -> Vector:
    """Return the least error of a derivative by the volatility, strikes, shape (n,).

    sigma T V_xx is what a European option's vega is made of, sigma^2 T the variance.
    """
    least: Vector = BY_VOLATILITY * book.deviation * np.sqrt(book.expiry) * found.local_change[:, BY_X_TWICE]
    return least


def by_parameters(book: Book, found: MarchedSegments, *, extended: bool) -> Columns:
    """Return the Greeks by the parameters, and their errors, as columns of `Prices`.

    Parameters
    ----------
    book : Book
        Every entry of its curves and dividends by which there is a derivative is at the end of a segment
        (`lacks_cuts`).
    extended : bool
        Whether vanna, volga and the buckets are wanted as well.
    """
    gradient = _Changing(found.by_segment, found.by_segment_change)
    if book.escrowed.any():
        gradient = _through_escrow(book, found, gradient)
    total, change = (
        np.add.reduceat(numbers, book.first[:-1], axis=0) for numbers in (gradient.value, gradient.change)
    )
    spot = book.diffusing() / book.strike
    by_x, by_x_twice = found.local_change[:, BY_X], found.local_change[:, BY_X_TWICE]
    by_rate = BY_RATES * book.expiry * by_x
    least = {
        "rate": by_rate,
        "dividend_yield": by_rate,
        "volatility": _least_by_volatility(book, found),
    }
    columns: Columns = {}
    for k, name in enumerate(CURVES):
        columns[PARALLEL[name]] = book.strike * total[:, k]
        columns[error_of(PARALLEL[name])] = book.strike * np.maximum(CHANGE_SHARE * change[:, k], least[name])
    columns |= _by_dividends(book, gradient, BY_DIVIDEND * by_x / spot)
    if book.local is not None:
        delta = _Changing(found.local[:, BY_X] / spot, by_x / spot)
        shift = _Changing(total[:, SHIFT], change[:, SHIFT])
        columns |= _sticky_moneyness(book, found.exercised, delta, shift, least["volatility"])
    if extended:
        vanna, volga = found.local[:, VOLATILITY_AND_X], found.local[:, VOLATILITY_TWICE]
        vanna_change, volga_change = found.local_change[:, VOLATILITY_AND_X:VOLATILITY].T
        of_vanna = OF_VANNA * np.sqrt(book.expiry) * by_x_twice
        of_volga = OF_VOLGA * book.expiry * by_x_twice
        speed = BOUNDARY_SPEED * np.sqrt(book.expiry)
        jump = found.local[:, JUMP] * speed
        columns["vanna"] = vanna / spot
        columns["vanna_error"] = (np.maximum(FLAT_SHARE * vanna_change, of_vanna) + jump) / spot
        columns["volga"] = book.strike * volga
        volga_error = np.maximum(FLAT_SHARE * volga_change, of_volga) + jump * speed
        columns["volga_error"] = book.strike * volga_error
        for k, name in enumerate(CURVES):
            columns |= _by_pieces(book, name, gradient, k, least[name])
    return columns


def _sticky_moneyness(
    book: Book, exercised: BoolVector, delta: _Changing, shift: _Changing, least: Vector
) -> Columns:
    """Return the derivative by the spot if the local volatility moves along with it, and its error.

    `delta` and `shift` are the derivatives by the spot and by a shift of the volatility in ln S, shape (n,), and
    `least` is the least error of the one by the volatility.
    """
    local, quoted = book.is_local(), book.spot / book.strike
    volatility, variance_slope = book.volatility_now()
    # By ln S, which a shift changes the volatility by; nothing where that is 0.
    slope = 0.5 * variance_slope * book.spot / np.where(volatility > 0.0, volatility, math.inf)
    value = delta.value + shift.value / quoted
    error = delta.change + np.maximum(CHANGE_SHARE * shift.change, np.abs(slope) * least) / quoted
    return {
        STICKY: np.where(local, np.where(exercised, -book.sign, value), math.nan),
        error_of(STICKY): np.where(local, np.where(exercised, 0.0, error), math.nan),
    }


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


def _through_escrow(book: Book, found: MarchedSegments, gradient: _Changing) -> _Changing:
    """Return the derivatives with the escrow's own dependence on rates and dividends taken into those by these.

    In the escrowed model the spot that diffuses, and the strike at every time, are less by what the dividends due are
    worth.
    """
    value, change, segments = gradient.value.copy(), gradient.change.copy(), book.segments
    discount = np.exp(-segments.rate * segments.duration)
    escrow = book.escrow() / book.per_segment(book.strike)
    fall = segments.duration * discount * escrow  # of what the escrow is worth, by the rate
    spot = book.diffusing() / book.strike
    by_escrow, by_escrow_change = -found.local[:, BY_X] / spot, found.local_change[:, BY_X] / spot
    for places, everywhere in book.by_place():
        escrowed = book.escrowed[places]
        rows, at = places[escrowed], everywhere[escrowed]
        value[at, RATE] -= fall[at] * by_escrow[rows]
        change[at, RATE] += fall[at] * by_escrow_change[rows]
        by_escrow[rows] = discount[at] * by_escrow[rows] + gradient.value[at, ESCROW]
        by_escrow_change[rows] = discount[at] * by_escrow_change[rows] + gradient.change[at, ESCROW]
        value[at, AMOUNT], change[at, AMOUNT] = by_escrow[rows], by_escrow_change[rows]
    return _Changing(value, change)


def _by_dividends(book: Book, gradient: _Changing, least: Vector) -> dict[str, Ragged]:
    """Return the derivative by each cash dividend, 0 for those not due, and its error, at least `least`, (n,)."""
    listed = book.listed.cash_dividends
    value, error = np.zeros((2, listed.values.size))
    if listed.values.size:
        owner, time, expiry = listed.owner(), listed.values, book.expiry[listed.owner()]
        segment, ends_there = _segment_at(book, owner, time)
        due = np.flatnonzero((time > SAME_TIME * expiry) & ends_there)
        value[due] = gradient.value[segment[due], AMOUNT]
        changes = FLAT_SHARE * gradient.change[segment[due], AMOUNT]
        error[due] = np.maximum(changes, least[owner[due]])
    return {DIVIDENDS: Ragged(listed.first, value), error_of(DIVIDENDS): Ragged(listed.first, error)}


def _by_pieces(book: Book, name: str, gradient: _Changing, k: int, least: Vector) -> dict[str, Ragged]:
    """Return the derivative by each value of a curve, the sum over the segments in its piece, and its error.

    The errors are at least `least`, in strikes, (n,).
    """
    listed = getattr(book.listed, name)
    value, error = np.zeros((2, listed.values.size))
    if listed.values.size:
        owner = np.repeat(np.arange(book.count), np.diff(book.first))
        chosen = np.flatnonzero(listed.counts()[owner] > 0)
        segments, owner = book.segments.take(chosen), owner[chosen]
        middle = _keys(book, owner, 0.5 * (segments.start + segments.end))
        ends = _keys(book, listed.owner(), listed.values)
        piece = np.minimum(np.searchsorted(ends, middle), listed.first[owner + 1] - 1)
        strike = book.strike[owner]
        value += np.bincount(piece, strike * gradient.value[chosen, k], value.size)
        changes = np.bincount(piece, strike * gradient.change[chosen, k], error.size)
        error += np.maximum(CHANGE_SHARE * changes, (book.strike * least)[listed.owner()])
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
