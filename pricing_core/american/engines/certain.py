"""Contracts whose spot does not diffuse: zero volatility, or a spot of zero."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from pricing_core.american.book.book import Book
from pricing_core.arrays import BoolVector, Vector

# Largest ratio of strike and boundary that is looked for, the number of spots tried in a round, and rounds; chosen.
FURTHEST, TRIED, ROUNDS = 1e9, 257, 5
ROUNDING = 1e-13  # By which a value may exceed what exercise brings and be the same; chosen.
BOUNDARY_DEVIATIONS = 4.0  # By which a boundary may be off that volatility moves; chosen.
FAR = math.exp(15.0)  # Smallest ratio of spot and strike of options that may never reach the strike; chosen.


def certain_value(book: Book) -> Vector:
    """Return the value of the best time to exercise on the spot's certain path, money, shape (n,).

    On a segment exercise pays +-(K e^{-rt} - S e^{-qt}), which has one stationary point, r K e^{-rt} = q S e^{-qt}:
    the best of both ends and that point.
    """
    segments, sign, strike = book.segments, book.sign, book.strike
    spot, discount, best = book.diffusing(), np.ones(book.count), np.zeros(book.count)
    duration, escrow, drops = segments.duration, book.escrow(), book.drops()
    with np.errstate(all="ignore"):
        for rows, at in book.by_place():
            s, d, k, side = spot[rows], discount[rows], strike[rows], sign[rows]
            h, rate, dividend_yield = duration[at], segments.rate[at], segments.dividend_yield[at]

            def paid(
                t: Vector,
                s: Vector = s,
                d: Vector = d,
                k: Vector = k,
                side: Vector = side,
                h: Vector = h,
                rate: Vector = rate,
                dividend_yield: Vector = dividend_yield,
                due: Vector = escrow[at],
            ) -> Vector:
                bond = (k - due * np.exp(-rate * (h - t))) * np.exp(-rate * t)
                result: Vector = side * d * (bond - s * np.exp(-dividend_yield * t))
                return result

            stationary = np.log(dividend_yield * s / (rate * k)) / (dividend_yield - rate)
            inside = segments.exercisable[at] & (stationary > 0.0) & (stationary < h)
            pays = np.where(segments.exercisable[at], paid(np.zeros_like(h)), 0.0)
            pays = np.maximum(pays, np.where(inside, paid(np.where(inside, stationary, 0.0)), 0.0))
            at_end = segments.exercisable[at] | segments.exercise_at_end[at]
            best[rows] = np.maximum(best[rows], np.maximum(pays, np.where(at_end, paid(h), 0.0)))
            grown = s * np.exp((rate - dividend_yield) * h)
            spot[rows] = np.maximum(grown * (1.0 - segments.fraction[at]) - drops[at], 0.0)
            discount[rows] = d * np.exp(-rate * h)
    return np.maximum(np.maximum(best, sign * (strike - spot) * discount), 0.0)


def moved_boundary(book: Book, boundary: Vector) -> Vector:
    """Return by how much volatility may move boundaries that are known without it, money, shape (n,) as they are."""
    moved: Vector = BOUNDARY_DEVIATIONS * book.deviation * boundary
    return moved


def certain_ends(book: Book, times: Vector, check: Callable[[], None]) -> tuple[Vector, Vector]:
    """Return the ends of the exercise region of one contract whose volatility is left out, (near, far), money, (m,).

    Of several intervals it is the one next to the strike; NaN where there is no such end. At a time at which something
    happens they are those just before it. Spots are tried from the strike on; `check` is called between the times, and
    may raise: each takes 50 ms with hundreds of events.
    """
    found = np.full((2, times.size), math.nan)
    outermost = -book.sign.item(0) * math.log(FURTHEST)
    for k, t in enumerate(times.tolist()):
        check()
        left = _left_at(book, t)
        escrow = left.escrow_now().item(0)
        strike = left.strike.item(0) - escrow
        if strike <= 0.0:
            continue
        begins = _first(left, strike, 0.0, outermost, exercised=True)
        ends = _first(left, strike, begins, outermost, exercised=False)
        found[:, k] = strike * np.exp([begins, ends]) + escrow
    return found[0], found[1]


def _first(book: Book, strike: float, start: float, end: float, *, exercised: bool) -> float:
    """Return the first place between two, ln(S/strike), at which one contract is exercised at once, or is not."""
    for _ in range(0 if math.isnan(start) else ROUNDS):
        places = np.linspace(start, end, TRIED)
        wanted = np.flatnonzero(_is_exercised(book, strike * np.exp(places)) == exercised)
        if wanted.size == 0:
            return math.nan
        start, end = places[max(wanted[0] - 1, 0)], places[wanted[0]]
    return math.nan if math.isnan(start) else end


def _left_at(book: Book, t: float) -> Book:
    """Return one contract as it is a time from now; what happens then is still to come."""
    segments = book.segments
    kept = segments.take(np.flatnonzero(segments.end >= t))
    kept = replace(kept, start=np.maximum(kept.start - t, 0.0), end=kept.end - t)
    return replace(book, first=np.array([0, kept.end.size]), segments=kept)


def _is_exercised(book: Book, diffusing: Vector) -> BoolVector:
    """Tell at which spots that diffuse one contract is exercised at once, shape (m,)."""
    rows = book.take(np.zeros(diffusing.size, dtype=np.intp))
    rows = rows.diffusing_at(diffusing)
    payoff = rows.payoff()
    now = rows.now
    allowed = now.exercisable | (now.exercise_at_end & (now.end == 0.0))
    exercised: BoolVector = allowed & (payoff > 0.0) & (certain_value(rows) <= payoff * (1.0 + ROUNDING))
    return exercised


def uncertainty(book: Book) -> Vector:
    """Return bounds on what the volatility adds to or takes from `certain_value`, money, shape (n,).

    For every stopping time |E e^{-rt} (K - S_t)^+ - ...| <= S e^{-qt} E |e^{sigma W - sigma**2 t/2} - 1|, and by
    Doob's inequality |V - V(volatility 0)| is at most 2 S sup e^{-int q} sqrt(e^{int sigma**2} - 1). Dividends make the
    spot at most smaller, and int -q is at most that of its positive part.
    """
    segments, starts = book.segments, book.first[:-1]
    variance = np.add.reduceat(segments.volatility**2 * segments.duration, starts)
    growth = np.add.reduceat(np.maximum(-segments.dividend_yield, 0.0) * segments.duration, starts)
    bound = 2.0 * book.spot * np.exp(growth) * np.sqrt(np.expm1(np.minimum(variance, 1.0)))
    bound = np.where((variance > 1.0) & (book.spot > 0.0), np.inf, bound)
    rows = np.flatnonzero(is_far_out_of_the_money(book))
    if rows.size:
        bound[rows] = np.minimum(bound[rows], _out_of_reach(book.take(rows)))
    return bound


def is_far_out_of_the_money(book: Book) -> BoolVector:
    """Tell contracts whose spot is millions of times the strike of a put, or a call's strike millions of times it."""
    spot, strike = book.spot, book.strike
    far_put, far_call = spot >= FAR * strike, (FAR * spot <= strike) & (spot > 0.0)
    return (far_put & book.is_put) | (far_call & ~book.is_put)


def _out_of_reach(book: Book) -> Vector:
    """Return bounds on the values of options out of the money, money, shape (n,); infinite where a dividend is due.

    The spot reaches the strike with probability at most 2 N(-x/s), x = |ln(S/K)| - int |r - q| - s**2/2 and
    s**2 = int sigma**2, by the reflection principle; for a call under the measure of the share, in which it earns
    e^{-int q} S at most. A put earns e^{-int r} K.
    """
    segments, starts = book.segments, book.first[:-1]
    duration, is_put = segments.duration, book.per_segment(book.is_put)
    variance = np.add.reduceat(segments.volatility**2 * duration, starts)
    drift = np.add.reduceat(np.abs(segments.rate - segments.dividend_yield) * duration, starts)
    growth = np.where(is_put, -segments.rate, -segments.dividend_yield)
    most = np.where(book.is_put, book.strike, book.spot) * np.exp(
        np.add.reduceat(np.maximum(growth, 0.0) * duration, starts)
    )
    distance = np.abs(np.log(book.spot / book.strike)) - drift - 0.5 * variance
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = np.where(variance > 0.0, 2.0 * ndtr(-distance / np.sqrt(variance)), 0.0)
    pays = np.logical_or.reduceat((segments.due > 0.0) | (segments.fraction > 0.0), starts)
    return np.where(pays | (distance <= 0.0), np.inf, most * chance)
