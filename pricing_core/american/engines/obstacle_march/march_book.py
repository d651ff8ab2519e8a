"""A book of contracts for the kernel's march, and what it finds of them in money."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.arrays import BoolVector, Vector
from pricing_core.obstacle.settings import CELLS, ROUNDED, STEPS, WIDTH


@dataclass(frozen=True, slots=True, eq=False)
class MarchedBook:
    """What the march finds of n contracts; arrays have shape (n,).

    Parameters
    ----------
    value, error_estimate : Vector
        Money.
    delta, gamma : Vector
        By the spot that diffuses.
    boundary : Vector
        The spot at which exercise begins now, of two the one nearer the strike, money; NaN without one.
    exercised, met, settled : bool array
        Whether the spot lies in the exercise region, the estimate meets the tolerance, and every stage was solved.
    cells, steps : int array
        The finest grid's.
    """

    value: Vector
    error_estimate: Vector
    delta: Vector
    gamma: Vector
    boundary: Vector
    exercised: BoolVector
    met: BoolVector
    settled: BoolVector
    cells: NDArray[np.int64]
    steps: NDArray[np.int64]


def march_book(
    book: Book, tolerance: Vector, threads: int = 1, interrupt: Callable[[], bool] | None = None
) -> MarchedBook:
    """March contracts with a volatility above 0 and a spot above what is escrowed, to a tolerance.

    Parameters
    ----------
    book : Book
    tolerance : Vector, shape (n,)
        Fractions of the strikes.
    threads : int
    interrupt : callable, optional
        True ends the work; what is not found then is NaN.
    """
    assert kernel.march_segments is not None
    assert kernel.SegmentTable is not None
    assert kernel.MarchSettings is not None
    columns, strikes = book.segments, book.per_segment(book.strike)
    spot = (book.spot - book.escrow_now()) / book.strike
    table = kernel.SegmentTable(
        sign=book.sign,
        x=np.log(spot),
        first=book.first,
        duration=columns.duration,
        rate=columns.rate,
        dividend_yield=columns.dividend_yield,
        volatility=columns.volatility,
        exercisable=columns.exercisable,
        exercise_at_end=columns.exercise_at_end,
        fraction=columns.fraction,
        amount=book.drops() / strikes,
        escrow=book.escrow() / strikes,
    )
    # A pair of grids may do here, where the library's own march takes three: the coarsest is twice as coarse.
    settings = kernel.MarchSettings(cells=CELLS // 2, width=WIDTH, steps=STEPS, rounded=ROUNDED)
    numbers, flags, counts = kernel.march_segments(table, tolerance, settings, threads, interrupt)
    value, slope, bend, error, boundary = numbers
    exercised, met, settled = flags
    cells, steps = counts
    return MarchedBook(
        book.strike * value,
        book.strike * error,
        slope / spot,
        (bend - slope) / (spot * spot * book.strike),
        book.strike * boundary + book.escrow_now(),
        exercised,
        met,
        settled,
        cells,
        steps,
    )
