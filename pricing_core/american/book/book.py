"""Contracts in columns: every one a sequence of segments without events, with the events at their ends."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.ragged import Ragged, gather, join_starts, starts
from pricing_core.american.book.reduction import Reduction, engine_times
from pricing_core.american.book.segments import LocalTerms, Segment, Segments, columns_of, segment_rows
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import times_of
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import BoolVector, Vector, every, some
from pricing_core.errors import InvalidInputError

Rows: TypeAlias = NDArray[np.intp]
CURVES = ("rate", "dividend_yield", "volatility")  # the market's parameters that may be curves


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """What each contract lists, for derivatives by each entry; every column has one list per contract.

    Parameters
    ----------
    cash_dividends : Ragged
        Ex-times in order, years from now, of those before now and after expiry as well.
    rate, dividend_yield, volatility : Ragged
        The `times` of the curves; empty where the parameter is a number.
    """

    cash_dividends: Ragged
    rate: Ragged
    dividend_yield: Ragged
    volatility: Ragged

    @classmethod
    def nothing(cls, count: int) -> Listed:
        """Return empty lists for so many contracts."""
        return cls(*[Ragged.empty(count)] * 4)

    def take(self, rows: Rows) -> Listed:
        """Return the lists of some contracts."""
        return Listed(*(getattr(self, name).take(rows) for name in self.__slots__))

    @classmethod
    def concatenated(cls, parts: Sequence[Listed]) -> Listed:
        """Return the lists of several books in one, in their order."""
        return cls(*(Ragged.concatenated([getattr(part, name) for part in parts]) for name in cls.__slots__))


@dataclass(frozen=True, eq=False)
class Book:
    """Contracts, n of them, each of at least one segment; a contract without events has one.

    Parameters
    ----------
    is_put : bool array, shape (n,)
    strike, spot : Vector, shape (n,)
        Money; the spot as it is quoted.
    escrowed : bool array, shape (n,)
        Whether the spot less the present value of the dividends due is what diffuses.
    first : int array, shape (n + 1,)
        Where the segments of each contract begin, and the end.
    segments : Segments
        The segments of each contract in the order of time, one contract after the other.
    listed : Listed
    reduction : Reduction or None
        What the contracts state beyond the option that the engines price; None where that is nothing.
    local : object array of (LocalTerms or None), shape (n,), or None
        The volatilities that depend on the spot; None where no contract has one.
    is_plain : bool
        Whether no contract has an event before its expiry, or a dividend then.
    """

    is_put: BoolVector
    strike: Vector
    spot: Vector
    escrowed: BoolVector
    first: NDArray[np.int64]
    segments: Segments
    listed: Listed
    reduction: Reduction | None = None
    local: NDArray[np.object_] | None = None
    is_plain: bool = field(init=False)

    def __post_init__(self) -> None:
        segments = self.segments
        plain = self.is_simple and not (some(segments.fraction) or some(segments.due))
        object.__setattr__(self, "is_plain", plain)

    @classmethod
    def of(cls, contracts: Sequence[tuple[Option, Market]]) -> Book:
        """Return the book of these contracts.

        Raises
        ------
        InvalidInputError
            Escrowed dividends are worth the spot or more.
        """
        local = [LocalTerms.of(*contract) for contract in contracts]
        rows = [segment_rows(*contract, own) for contract, own in zip(contracts, local, strict=True)]
        terms = [
            (option.is_put, option.strike, market.spot, market.dividend_model == "escrowed")
            for option, market in contracts
        ]
        is_put, strike, spot, escrowed = np.array(terms, dtype=np.float64).reshape(len(terms), 4).T
        book = cls(
            is_put != 0.0,
            strike,
            spot,
            escrowed != 0.0,
            starts(np.array([len(own) for own in rows], dtype=np.int64)),
            Segments.of_rows([row for own in rows for row in own]),
            _listed(contracts),
            Reduction.of(contracts),
            _column_of(local),
        )
        if some(book.escrowed):
            due = book.escrow_now()
            for row in np.flatnonzero((due > 0.0) & (due >= spot)).tolist():
                allowed = "worth less today than the spot in the escrowed model"
                raise InvalidInputError("cash_dividends", due.item(row), allowed)
        return book

    @classmethod
    def at_strike(cls, option: Option, market: Market) -> Book:
        """Return the contract with the spot at the strike, above what escrowed dividends are worth.

        For questions that do not depend on the spot; a market whose own spot is too small for them is served.
        """
        due = math.fsum(dividend.amount for dividend in market.cash_dividends)
        book = cls.of([(option, replace(market, spot=option.strike + due))])
        return book.diffusing_at(book.strike)

    def diffusing_at(self, spot: Vector) -> Book:
        """Return the contracts with other spots that diffuse, money, shape (n,)."""
        return replace(self, spot=spot + self.escrow_now())

    @property
    def count(self) -> int:
        """The number of contracts n."""
        return self.spot.size

    @property
    def sign(self) -> Vector:
        """1 for puts, -1 for calls, shape (n,)."""
        return np.where(self.is_put, 1.0, -1.0)

    @cached_property
    def expiry(self) -> Vector:
        """Years from now, shape (n,)."""
        return self.segments.end if self.is_simple else self.segments.end[self.first[1:] - 1]

    @property
    def is_simple(self) -> bool:
        """Whether every contract has one segment, so that segments and contracts are the same rows."""
        return self.segments.end.size == self.spot.size

    @cached_property
    def deviation(self) -> Vector:
        """The standard deviation of ln S at expiry, shape (n,); of a local volatility what stands for it."""
        segments = self.segments
        variance = segments.volatility**2 * segments.duration
        return np.sqrt(variance if self.is_simple else np.add.reduceat(variance, self.first[:-1]))

    def has_events(self) -> BoolVector:
        """Tell which contracts have more than one segment, or a dividend at expiry, shape (n,)."""
        last = self.first[1:] - 1
        paid = (self.segments.fraction[last] > 0.0) | (self.segments.due[last] > 0.0)
        return paid | (np.diff(self.first) > 1)

    def payoff(self) -> Vector:
        """Return what exercise brings now, (11.47), money, shape (n,)."""
        return np.maximum(np.where(self.is_put, self.strike - self.spot, self.spot - self.strike), 0.0)

    def exercise_value(self) -> Vector:
        """Return what exercise now is worth now, money, shape (n,): the payoff, discounted to when it is paid."""
        return self.payoff() if self.reduction is None else self.reduction.discount * self.payoff()

    @cached_property
    def now(self) -> Segments:
        """The segment of each contract that holds now."""
        return self.segments if self.is_simple else self.segments.take(self.first[:-1])

    def per_segment(self, column: NDArray[Any]) -> NDArray[Any]:
        """Return a column of the contracts for each of their segments, shape (m,)."""
        return column if self.is_simple else np.repeat(column, np.diff(self.first))

    def by_place(self, *, backward: bool = False) -> Iterator[tuple[Rows, NDArray[np.int64]]]:
        """Yield for the first, second, ... segment the contracts that have one, and where it is.

        Parameters
        ----------
        backward : bool
            Whether the last segments come first, as from expiry.
        """
        rows, counts = np.arange(self.count), np.diff(self.first)
        for place in range(int(counts.max(initial=0))):
            rows = rows[counts[rows] > place]
            yield rows, (self.first[rows + 1] - 1 - place if backward else self.first[rows] + place)

    def escrow(self) -> Vector:
        """Return what the cash dividends still due are worth at the end of each segment, before those there.

        Money, shape (m,); 0 in the spot model. t years before the segment's end it is e^{-rate t} times that.
        """
        escrow = np.zeros(self.segments.end.size)
        if some(self.escrowed):
            due = np.where(self.per_segment(self.escrowed), self.segments.due, 0.0)
            discount = np.exp(-self.segments.rate * self.segments.duration)
            due_later = np.zeros(self.count)
            for rows, at in self.by_place(backward=True):
                escrow[at] = due_later[rows] + due[at]
                due_later[rows] = escrow[at] * discount[at]
        return escrow

    def escrow_now(self) -> Vector:
        """Return what the cash dividends due are worth now in the escrowed model, money, shape (n,)."""
        if not some(self.escrowed):
            return np.zeros(self.count)
        now = self.now
        return self.escrow()[self.first[:-1]] * np.exp(-now.rate * now.duration)

    def diffusing(self) -> Vector:
        """Return the spots that diffuse, money, shape (n,): in the escrowed model less what the dividends are worth."""
        return self.spot - self.escrow_now()

    def drops(self) -> Vector:
        """Return the amounts by which the spot that diffuses drops at the ends of the segments, money, (m,)."""
        due = self.segments.due
        return np.where(self.per_segment(self.escrowed), 0.0, due) if some(self.escrowed) else due

    def european(self) -> Book:
        """Return the same contracts without early exercise."""
        never = np.zeros(self.segments.end.size, dtype=bool)
        return replace(self, segments=replace(self.segments, exercisable=never, exercise_at_end=never))

    def take(self, rows: Rows) -> Book:
        """Return some of the contracts, in the order asked for."""
        if rows.size == self.count and bool(every(rows == np.arange(rows.size))):
            return self
        first, chosen = (np.arange(rows.size + 1), rows) if self.is_simple else gather(self.first, rows)
        return Book(
            self.is_put[rows],
            self.strike[rows],
            self.spot[rows],
            self.escrowed[rows],
            first,
            self.segments.take(chosen),
            self.listed.take(rows),
            None if self.reduction is None else self.reduction.take(rows),
            None if self.local is None else self.local[rows],
        )

    def part(self, rows: slice) -> Book:
        """Return consecutive contracts; the columns of those with one segment each are not copied."""
        if not self.is_simple:
            return self.take(np.arange(self.count)[rows])
        chosen = np.arange(self.count)[rows]
        return Book(
            self.is_put[rows],
            self.strike[rows],
            self.spot[rows],
            self.escrowed[rows],
            np.arange(chosen.size + 1),
            self.segments.take(rows),
            self.listed.take(chosen),
            None if self.reduction is None else self.reduction.take(chosen),
            None if self.local is None else self.local[rows],
        )

    @classmethod
    def concatenated(cls, books: Sequence[Book]) -> Book:
        """Return the contracts of at least one book in one book, in their order."""
        if len(books) == 1:
            return books[0]
        return cls(
            np.concatenate([book.is_put for book in books]),
            np.concatenate([book.strike for book in books]),
            np.concatenate([book.spot for book in books]),
            np.concatenate([book.escrowed for book in books]),
            join_starts([book.first for book in books]),
            Segments.concatenated([book.segments for book in books]),
            Listed.concatenated([book.listed for book in books]),
            _reduction_of(books),
            _local_of_books(books),
        )

    def is_local(self) -> BoolVector:
        """Tell which contracts have a volatility that depends on the spot, shape (n,)."""
        if self.local is None:
            return np.zeros(self.count, dtype=bool)
        return np.array([terms is not None for terms in self.local], dtype=bool)

    def volatility_now(self) -> tuple[Vector, Vector]:
        """Return the volatility at the spot that diffuses now, and d volatility**2/dS there, each of shape (n,)."""
        volatility, slope = self.now.volatility, np.zeros(self.count)
        if self.local is None:
            return volatility, slope
        volatility, spot = volatility.copy(), self.diffusing()
        for row in np.flatnonzero(self.is_local() & (spot > 0.0)).tolist():
            terms, place = self.local[row], spot.item(row)
            here = float(terms.volatility.at(0.0, place))
            volatility[row] = max(volatility[row] - terms.reference + here, 0.0)
            if here > 0.0:
                slope[row] = terms.volatility.variance_slope(place) * volatility[row] / here
        return volatility, slope

    def with_volatility(self, volatility: Vector) -> Book:
        """Return the contracts with constant volatilities, shape (n,)."""
        listed = replace(self.listed, volatility=Ragged.empty(self.count))
        segments = replace(self.segments, volatility=self.per_segment(volatility))
        return replace(self, segments=segments, listed=listed, local=None)

    def with_surfaces_moved(self, by: float) -> Book:
        """Return the contracts with the spots of their local volatilities moved by so much in ln S."""
        assert self.local is not None
        factor = math.exp(by)
        moved = [terms and replace(terms, volatility=terms.volatility.moved(factor)) for terms in self.local]
        return replace(self, local=_column_of(moved))

    def local_terms(self, row: int = 0) -> LocalTerms | None:
        """Return the local volatility of a contract, None where it has none."""
        return None if self.local is None else self.local[row]

    def segments_of(self, row: int = 0) -> tuple[Segment, ...]:
        """Return the segments of a contract in the order of time."""
        alone = self if self.count == 1 else self.part(slice(row, row + 1))
        columns = (*columns_of(alone.segments), alone.drops(), alone.escrow())
        return tuple(itertools.starmap(Segment, zip(*(column.tolist() for column in columns), strict=True)))


def _reduction_of(books: Sequence[Book]) -> Reduction | None:
    if all(book.reduction is None for book in books):
        return None
    return Reduction.concatenated([book.reduction or Reduction.nothing(book.count) for book in books])


def _local_of_books(books: Sequence[Book]) -> NDArray[np.object_] | None:
    if all(book.local is None for book in books):
        return None
    nothing = (np.full(book.count, None, dtype=object) for book in books)
    return np.concatenate(
        [none if book.local is None else book.local for book, none in zip(books, nothing, strict=True)]
    )


def _column_of(local: Sequence[LocalTerms | None]) -> NDArray[np.object_] | None:
    if all(terms is None for terms in local):
        return None
    column = np.empty(len(local), dtype=object)
    column[:] = local
    return column


def _listed(contracts: Sequence[tuple[Option, Market]]) -> Listed:
    """Return the times of the dividends and curves, those of curves as the engines see them."""
    markets = [market for _, market in contracts]
    if not any(market.cash_dividends or market.has_curves() for market in markets):
        return Listed.nothing(len(markets))
    dividends = Ragged.of([[d.time for d in market.cash_dividends] for market in markets])
    rate, dividend_yield = zip(*(engine_times(*contract) for contract in contracts), strict=True)
    volatility = [times_of(market.volatility) for market in markets]
    return Listed(dividends, Ragged.of(rate), Ragged.of(dividend_yield), Ragged.of(volatility))
