"""Contracts of a chain or a ladder of spots that share their solves.

Contracts that differ in the spot alone have one solution, on a grid that holds all spots: each sweep is done once. So
have contracts without cash dividends and with a volatility that does not depend on the spot, whatever their strikes:
their value is homogeneous in both. Between the strikes of other contracts prices are interpolated (`across_strikes`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import Prices, prices
from pricing_core.american.contracts.schedule import Schedule
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.method_of_lines.across_strikes import FEWEST_STRIKES, across_strikes
from pricing_core.american.engines.method_of_lines.sweep_problem import SharedSweeps

# Prices a book, whose contracts share these sweeps where they are given.
Solve = Callable[[Book, Request, SharedSweeps | None], Prices]


def solve_shared(book: Book, request: Request, solve: Solve) -> Prices:
    """Price a book with shared solves; a contract whose price misses its tolerance so is priced on its own."""
    schedules = [book.schedule(row) for row in range(book.count)]
    ladders = _alike(range(book.count), lambda row: _ladder(book, request, schedules[row], row))
    found = prices(book.count)
    for rows in ladders:
        if rows.size > 1:
            spots = tuple(schedules[row].spot / schedules[row].strike for row in rows.tolist())
            alike = _one_ladder(book.take(rows))
            found = found.replaced(rows, solve(alike, request.take(rows), SharedSweeps(spots)))
    single = [int(rows[0]) for rows in ladders if rows.size == 1]
    for rows in _alike(single, lambda row: _chain(book, request, schedules[row], row)):
        part, asked = book.take(rows), request.take(rows)
        if rows.size >= FEWEST_STRIKES:
            answer = across_strikes(part, asked, lambda book, request: solve(book, request, None))
        else:
            answer = solve(part, asked, None)
        found = found.replaced(rows, answer)
    missed = np.flatnonzero(~(found.error <= request.tolerance * book.strike) & (found.status == "ok"))
    missed = np.setdiff1d(missed, np.array(single, dtype=np.intp))
    if missed.size:
        alone = solve(book.take(missed), request.take(missed), None)
        found = found.replaced(missed, alone)
    return found


def _alike(rows: range | list[int], key: Callable[[int], Hashable]) -> list[Rows]:
    """Return the rows in groups with equal keys."""
    groups: dict[Hashable, list[int]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return [np.array(group, dtype=np.intp) for group in groups.values()]


def _common(book: Book, request: Request, schedule: Schedule, row: int) -> tuple[Hashable, ...]:
    """Return what contracts that share anything have in common: all but spot and strike."""
    local, shift = None, 0.0
    if schedule.local is not None:  # whose reference depends on spot and strike
        local, shift = schedule.local.volatility, schedule.local.reference
    segments = tuple(
        replace(segment, volatility=round(segment.volatility - shift, 12)) for segment in schedule.segments
    )
    listed = tuple(getattr(book.listed, name).row(row) for name in type(book.listed).__slots__)
    return schedule.is_put, segments, local, listed, request.tolerance.item(row)


def _ladder(book: Book, request: Request, schedule: Schedule, row: int) -> Hashable:
    pays = any(segment.due > 0.0 for segment in schedule.segments)
    homogeneous = not pays and schedule.local is None
    return *_common(book, request, schedule, row), None if homogeneous else schedule.strike


def _chain(book: Book, request: Request, schedule: Schedule, row: int) -> Hashable:
    return *_common(book, request, schedule, row), book.spot.item(row)


def _one_ladder(book: Book) -> Book:
    """Return the contracts as the first one, but for spot and strike: so equal that their sweeps are the same."""
    alike = book.take(np.zeros(book.count, dtype=np.intp))
    return replace(alike, strike=book.strike, spot=book.spot, reduction=book.reduction)
