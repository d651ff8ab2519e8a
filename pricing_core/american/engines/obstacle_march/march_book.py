"""A book of contracts for the kernel's march."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import GREEKS
from pricing_core.american.engines.engine import Request

if TYPE_CHECKING:
    from pricing_core._kernels import MarchedSegments


def march_book(book: Book, request: Request) -> MarchedSegments:
    """March contracts with a volatility above 0 and a spot above what is escrowed, to their tolerances.

    What is found is in strikes. What an interrupt leaves out is NaN.
    """
    # Here, so that whoever prices without events does not load the general march.
    from pricing_core.obstacle.settings import CELLS, ROUNDED, STEPS, WIDTH  # noqa: PLC0415

    assert kernel.march_segments is not None
    assert kernel.SegmentTable is not None
    assert kernel.MarchSettings is not None
    columns, strikes = book.segments, book.per_segment(book.strike)
    table = kernel.SegmentTable(
        sign=book.sign,
        x=np.log((book.spot - book.escrow_now()) / book.strike),
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
    settings = kernel.MarchSettings(cells=CELLS, width=WIDTH, steps=STEPS, rounded=ROUNDED)
    return kernel.march_segments(
        table,
        request.tolerance,
        settings,
        GREEKS.choices.index(request.greeks),
        request.threads,
        request.interrupt,
    )
