"""A book of contracts for the kernel's march."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import GREEKS
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march.shared_marches import shared_marches
from pricing_core.arrays import BoolVector
from pricing_core.march_settings import CELLS, ROUNDED, STEPS, WIDTH

if TYPE_CHECKING:
    from pricing_core._kernels import MarchedSegments, VolatilitySurface

# Half the width of a grid in standard deviations of ln S. At its ends prices are linear in the spot: widths from 3.5 on
# change no price by more than 1e-8 strikes; boundaries are found where a grid reaches them. Measured.
WIDTH_OF_PRICES = 4.5
# The fewest steps of a segment over the cells, where boundaries between its ends are asked for; chosen.
STEPS_OF_BOUNDARIES = 0.125


def march_book(
    book: Book,
    request: Request,
    *,
    european: BoolVector | None = None,
    boundaries: bool = False,
    share: bool = False,
) -> MarchedSegments:
    """March contracts with a volatility above 0 and a spot above what is escrowed, to their tolerances.

    What is found is in strikes. What an interrupt leaves out is NaN. `european` tells which contracts are wanted
    without early exercise as well, shape (n,), and `boundaries` whether exercise boundaries over time are. With `share`
    contracts that differ in the spot alone are marched together, without derivatives by the numbers of segments.
    """
    assert kernel.march_segments is not None
    assert kernel.SegmentTable is not None
    assert kernel.MarchSettings is not None
    x, owner = np.log(book.diffusing() / book.strike), np.arange(book.count)
    if share:
        rows, owner = shared_marches(book)
        book, european = book.take(rows), None if european is None else european[rows]
    columns, strikes = book.segments, book.per_segment(book.strike)
    table = kernel.SegmentTable(
        sign=book.sign,
        x=x,
        owner=owner,
        european=np.zeros(book.count, dtype=bool) if european is None else european,
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
        local=_surfaces(book),
    )
    width = WIDTH if boundaries else WIDTH_OF_PRICES
    settings = kernel.MarchSettings(
        cells=round(CELLS * width / WIDTH),
        width=width,
        steps=STEPS,
        rounded=ROUNDED,
        fewest=STEPS_OF_BOUNDARIES if boundaries else 0.0,
    )
    return kernel.march_segments(
        table,
        request.tolerance,
        settings,
        GREEKS.choices.index(request.greeks),
        request.threads,
        request.interrupt,
    )


def _surfaces(book: Book) -> list[tuple[VolatilitySurface, float, float] | None] | None:
    """Return the local volatility of each contract, ln of its strike and what stands for it in the segments."""
    if book.local is None:
        return None
    assert kernel.VolatilitySurface is not None
    known: dict[int, VolatilitySurface] = {}
    found: list[tuple[VolatilitySurface, float, float] | None] = []
    for terms, strike in zip(book.local, book.strike.tolist(), strict=True):
        if terms is None:
            found.append(None)
            continue
        surface = terms.volatility
        if id(surface) not in known:
            # Without a dependence on the time steps need not end at its times.
            rows = 1 if surface.is_steady else surface.times.size
            known[id(surface)] = kernel.VolatilitySurface(
                times=surface.times[:rows],
                logs=np.log(surface.spots),
                values=surface.values[:rows],
                slopes=surface.slopes[:rows],
            )
        found.append((known[id(surface)], math.log(strike), terms.reference))
    return found
