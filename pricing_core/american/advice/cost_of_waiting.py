"""What a holder loses by waiting instead of exercising now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.ragged import Ragged, starts
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError


@dataclass(frozen=True, slots=True, eq=False)
class Costs:
    """What waiting costs, and how it was found.

    Parameters
    ----------
    exercise_now : bool
        Whether exercise is optimal now.
    cost, error : Vector, shape (m,)
        Money; the cost does not fall.
    status : {"ok", "tolerance_not_met"}
        Whether every price meets the tolerance.
    methods : set of str
        Methods by which the prices were found.
    """

    exercise_now: bool
    cost: Vector
    error: Vector
    status: str
    methods: set[str]


def cost_of_waiting(
    option: Option, market: Market, times: Vector, tolerance: float, interrupt: Callable[[], bool] | None
) -> Costs:
    """Return what the option is worth more than one that cannot be exercised before each time.

    This is the integral of the multiplier, discounted, over the time until then, under the law of a holder who does not
    exercise, with the loss at each ex-date before which exercise was better: at expiry the early exercise premium.

    Parameters
    ----------
    option : Option
    market : Market
    times : Vector, shape (m,)
        Increasing, 0 to the expiry.
    tolerance : float
        Tolerance of both prices.

    Raises
    ------
    NumericalError
        The interrupt came before the end, or a price was not found.
    """
    held = Book.of([(option, market)])
    book = Book.concatenated([held, without_rights(held.take(np.zeros(times.size, dtype=np.intp)), times)])
    found = solve(book, Request(np.full(book.count, tolerance), "none", interrupt=interrupt))
    if np.isnan(found.value).any() or "deadline" in found.status:
        raise NumericalError("the cost of waiting was not found: allow more time or a larger tolerance")
    value = found.value - found.value[0]
    cost = np.maximum.accumulate(np.maximum(-value[1:], 0.0))
    status = "ok" if (found.status == "ok").all() else "tolerance_not_met"
    error = found.error[1:] + found.error[0]
    return Costs(bool(found.exercised[0]), cost, error, status, set(found.method.tolist()))


def without_rights(book: Book, times: Vector) -> Book:
    """Return contracts without the right to exercise before a time each, shape (n,); at expiry it stays."""
    segments, time = book.segments, book.per_segment(times)
    inside = segments.exercisable & (segments.start < time) & (time < segments.end)
    counts = np.add.reduceat(inside, book.first[:-1], dtype=np.int64)
    book = with_cuts(book, Ragged(starts(counts), time[inside]))
    segments, time = book.segments, book.per_segment(times)
    early = 0.5 * (segments.start + segments.end) < time
    stays = ~early | (segments.end >= np.minimum(time, book.per_segment(book.expiry)))
    return replace(
        book,
        segments=replace(
            segments,
            exercisable=segments.exercisable & ~early,
            exercise_at_end=segments.exercise_at_end & stays,
        ),
    )
