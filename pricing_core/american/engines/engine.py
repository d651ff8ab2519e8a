"""What an engine is, and what it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.fields import Greeks
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError

INTERRUPTED = "interrupted before the boundary was found: allow more time"
UNRESOLVED = "no grid resolves the contract"  # what the message of a price says then


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What is wanted of a book of n contracts.

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Absolute errors of the prices, as fractions of the strikes.
    greeks : {"none", "standard", "extended"}
        "none" still lets an engine give delta, gamma and theta, which come free.
    share_solves : bool
        Whether contracts that differ in spot and strike alone may be priced from one solve.
    by_rates : bool
        Whether the Greeks by rates and dividends are wanted with the others; a shared march does not give them.
    threads : int
        How many an engine may use for one call of the kernel.
    interrupt : callable, optional
        True ends the work.
    deadline : Vector, shape (n,), optional
        Seconds that each contract may take, for whoever prices a book in parts.
    """

    tolerance: Vector
    greeks: Greeks = "standard"
    share_solves: bool = False
    by_rates: bool = True
    threads: int = 1
    interrupt: Callable[[], bool] | None = None
    deadline: Vector | None = None

    def take(self, rows: Rows | slice) -> Request:
        """Return the request for some of the contracts."""
        if isinstance(rows, np.ndarray) and rows.size == self.tolerance.size:
            return self
        deadline = None if self.deadline is None else self.deadline[rows]
        return replace(self, tolerance=self.tolerance[rows], deadline=deadline)

    def is_interrupted(self) -> bool:
        """Ask the interrupt, if there is one."""
        return self.interrupt is not None and self.interrupt()

    def end_if_interrupted(self) -> None:
        """End the search for a boundary where the interrupt says so.

        Raises
        ------
        NumericalError
            It does.
        """
        if self.is_interrupted():
            raise NumericalError(INTERRUPTED)


class Boundaries(NamedTuple):
    """The exercise boundary of one contract at given times, money; NaN where there is none.

    `near` is the one nearer the strike, `far` the other end of an exercise region that has two; `error` is the
    estimated absolute error of `near`. `found` tells at which times the engine settled the question. Every array has
    shape (m,).
    """

    near: Vector
    far: Vector
    error: Vector
    found: BoolVector

    def completed_by(self, other: Boundaries) -> Boundaries:
        """Return these boundaries, with those of `other` at the times at which these were not found."""
        columns = (np.where(self.found, mine, its) for mine, its in zip(self, other, strict=True))
        near, far, error, found = columns
        return Boundaries(near, far, error, found.astype(bool))


BoundariesAt: TypeAlias = Callable[[Vector], Boundaries]


class Engine(Protocol):
    """A way to price contracts."""

    @property
    def name(self) -> str:
        """What the engine is called."""
        ...

    @property
    def method(self) -> str:
        """What results say of it, but for contracts that need no method."""
        ...

    @property
    def least_error(self) -> float:
        """Error of a price, in strikes, above which this engine is asked where the tolerance is missed."""
        ...

    def serves(self, book: Book) -> BoolVector:
        """Tell which contracts the engine may be asked for, shape (n,)."""
        ...

    def solve(self, book: Book, request: Request) -> Prices:
        """Price contracts that the engine serves; those it gives up are not `settled`."""
        ...

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return the exercise boundary of a book of one contract that the engine serves, as a function of time.

        The function takes years from now, increasing, 0 to expiry, shape (m,); at a time at which something happens the
        boundary is the one just before it, at expiry the limit. What serves all times is solved once.
        It raises `NumericalError` where the interrupt came before the end.
        """
        ...
