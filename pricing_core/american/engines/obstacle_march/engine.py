"""The engine of the march of obstacle problems: every contract.

What it does is in `pricing.py`, which is imported where it is asked first: most books do without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.arrays import BoolVector, Vector


@dataclass(frozen=True, slots=True)
class ObstacleMarch:
    """The engine for every contract: any events, any number of exercise boundaries, volatilities that are local."""

    @property
    def name(self) -> str:
        """What the engine is called."""
        return "obstacle march"

    @property
    def least_error(self) -> float:
        """1e-6 strikes: below that the prices of the faster engines are as accurate as those of this one."""
        return 1e-6

    def serves(self, book: Book) -> BoolVector:
        """Return True for every contract with time to expiry and a spot above 0."""
        return (book.expiry > 0.0) & (book.spot > 0.0)

    def solve(self, book: Book, request: Request) -> Prices:
        """Price one contract after the other; what fails numerically has the status "out_of_domain"."""
        from pricing_core.american.engines.obstacle_march.pricing import solve_book  # noqa: PLC0415

        return solve_book(book, request)

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return both boundaries from one solve, or two where they begin far from the strike."""
        from pricing_core.american.engines.obstacle_march.pricing import BoundariesOf  # noqa: PLC0415

        return BoundariesOf(book, request)(times)


@dataclass(frozen=True, slots=True)
class MarchOfOneBook(ObstacleMarch):
    """The same engine for whoever asks for the boundaries of a contract again and again: it is solved once.

    Parameters
    ----------
    least_tolerance : float
        The smallest tolerance, in strikes, that boundaries are asked with.
    """

    least_tolerance: float
    _solved: list[tuple[Book, Callable[[Vector], Boundaries]]] = field(
        init=False, repr=False, compare=False, default_factory=list
    )

    def boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        """Return both boundaries from what is solved of this very book, at the tolerance of the first request."""
        from pricing_core.american.engines.obstacle_march.pricing import BoundariesOf  # noqa: PLC0415

        if not self._solved or self._solved[0][0] is not book:
            tolerance = np.maximum(request.tolerance, self.least_tolerance)
            self._solved[:] = [(book, BoundariesOf(book, replace(request, tolerance=tolerance)))]
        return self._solved[0][1](times)
