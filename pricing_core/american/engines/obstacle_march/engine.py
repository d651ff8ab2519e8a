"""The engine of the march of obstacle problems in NumPy.

What it does is in `pricing.py`, which is imported where it is asked first: most books do without it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import BoundariesAt, Request
from pricing_core.arrays import BoolVector

# Largest standard deviation of ln S at expiry: beyond it rounding takes more and more of calls, and grids many seconds.
LARGEST_DEVIATION = 14.0


@dataclass(frozen=True, slots=True)
class ObstacleMarch:
    """The engine for what the kernel does not take: any events, any number of boundaries, local volatilities."""

    @property
    def name(self) -> str:
        """What the engine is called."""
        return "obstacle march"

    @property
    def method(self) -> str:
        """What results say of it."""
        return "obstacle-march"

    @property
    def least_error(self) -> float:
        """Infinite: prices of the faster engines are as accurate; this one is asked where there are none."""
        return math.inf

    def serves(self, book: Book) -> BoolVector:
        """Tell contracts with time to expiry, a spot above 0 and a deviation at which calls keep their digits."""
        return (book.expiry > 0.0) & (book.spot > 0.0) & (book.deviation <= LARGEST_DEVIATION)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price one contract after the other; what fails numerically has the status "out_of_domain"."""
        from pricing_core.american.engines.obstacle_march.pricing import solve_book  # noqa: PLC0415

        return solve_book(book, request)

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return both boundaries from one solve, or a few where they begin far from the strike."""
        from pricing_core.american.engines.obstacle_march.boundaries import BoundariesOf  # noqa: PLC0415
        from pricing_core.american.engines.obstacle_march.pricing import solved_traces  # noqa: PLC0415

        return BoundariesOf(book, request, solved_traces)


class MarchWithoutKernel(ObstacleMarch):
    """The same where no kernel is compiled: beside it only what no grid resolves would be left, and take minutes."""

    __slots__ = ()

    def serves(self, book: Book) -> BoolVector:
        """Tell what `ObstacleMarch` serves, and nothing beside the compiled march."""
        return ObstacleMarch.serves(self, book) & (kernel.march_segments is None)
