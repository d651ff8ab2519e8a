"""Prices of a chain from those of some of its strikes, and polynomials between them.

All else equal, a price is a smooth function of the strike where the option is held, and the payoff where it is
exercised. Strikes in the middle of two others are priced until a polynomial through their neighbours predicts them to
the tolerance; the others are interpolated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pricing_core.american.book.book import Book, Rows
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, Prices, concatenated, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.engine import Request
from pricing_core.arrays import Matrix, Vector

FEWEST_STRIKES = 24  # Smallest number of strikes that are interpolated between; chosen.
FIRST_INTERVALS = 15  # Number of intervals to begin with: their ends fill the lanes of the kernel; chosen.
STENCIL, FEWEST_NODES = 6, 4  # Number of strikes of a polynomial, and the smallest that will do; chosen.
MISFIT_SHARE = (
    0.25  # Share of the tolerance that a polynomial may miss a price in the middle of two others by; chosen.
)
STILL_THERE = (
    "european",
    "boundary",
)  # What is smooth in the strike whether the option is held or exercised.


class _Stencil(NamedTuple):
    """Rows that are priced, and what each counts for in other rows."""

    nodes: Rows  # (k,)
    weights: Matrix  # (n, k)


class _Span(NamedTuple):
    """The rows between two that are priced, and by how much polynomials missed the one in the middle."""

    low: int
    high: int
    misfit: dict[str, Any] | None = None


def across_strikes(book: Book, request: Request, solve: Callable[[Book, Request], Prices]) -> Prices:
    """Price contracts that differ in the strike alone.

    Parameters
    ----------
    solve : callable
        Prices some of them.
    """
    order = np.argsort(book.strike, kind="stable")
    chain = _Chain(book.take(order), request.take(order), solve)
    chain.refine()
    return chain.all().take(np.argsort(order))


class _Chain:
    """A book sorted by strike, and which of its rows are priced."""

    def __init__(self, book: Book, request: Request, solve: Callable[[Book, Request], Prices]) -> None:
        self.book, self.solve = book, solve
        self.request = request
        self.logarithms = np.log(book.strike)
        self.found = prices(book.count)
        self.priced = np.zeros(book.count, dtype=bool)
        self.spans: list[_Span] = []

    def refine(self) -> None:
        """Price rows until each span between two of them is foretold, or has no row inside."""
        last = self.book.count - 1
        cuts = np.unique(np.round(np.linspace(0, last, FIRST_INTERVALS + 1)).astype(np.intp)).tolist()
        self._price(cuts)
        waiting = [_Span(low, high) for low, high in pairwise(cuts)]
        while waiting:
            middles = [np.array([(span.low + span.high) // 2]) for span in waiting]
            told = [self._told(row, span) for row, span in zip(middles, waiting, strict=True)]
            self._price(sorted({int(row[0]) for row in middles} - set(self._rows_priced())))
            following: list[_Span] = []
            for span, row, foretold in zip(waiting, middles, told, strict=True):
                halves = _Span(span.low, int(row[0])), _Span(int(row[0]), span.high)
                misfit = None if foretold is None else self._misfit(row, foretold)
                if misfit is None:
                    following += [half for half in halves if half.high - half.low > 1]
                else:
                    self.spans += [half._replace(misfit=misfit) for half in halves]
            waiting = following

    def all(self) -> Prices:
        """Return the prices of all rows; those that polynomials do not give are priced."""
        foretold: list[tuple[Rows, Prices]] = []
        for span in self.spans:
            rows = np.arange(span.low + 1, span.high)
            told = self._told(rows, span) if rows.size else None
            if told is not None:
                good = np.flatnonzero(told.error <= self._allowed(rows))
                foretold.append((rows[good], told.take(good)))
        done = np.concatenate([self._rows_priced(), *(rows for rows, _ in foretold)])
        self._price(np.setdiff1d(np.arange(self.book.count), done).tolist())
        if not foretold:
            return self.found
        rows = np.concatenate([rows for rows, _ in foretold])
        return self.found.replaced(rows, concatenated([told for _, told in foretold]))

    def _rows_priced(self) -> list[int]:
        rows: list[int] = np.flatnonzero(self.priced).tolist()
        return rows

    def _allowed(self, rows: Rows) -> Vector:
        return self.request.tolerance[rows] * self.book.strike[rows]

    def _price(self, rows: Sequence[int]) -> None:
        chosen: Rows = np.array(rows, dtype=np.intp)
        if chosen.size == 0:
            return
        solved = self.solve(self.book.take(chosen), self.request.take(chosen))
        self.found = self.found.replaced(chosen, solved)
        self.priced[chosen] = True

    def _misfit(self, row: Rows, told: Prices) -> dict[str, Any] | None:
        """Return by how much every number was foretold wrongly; None where the price or its kind was."""
        true = self.found.take(row)
        near = np.abs(told.value - true.value) <= MISFIT_SHARE * self._allowed(row)
        if true.status[0] != "ok" or told.exercised[0] != true.exercised[0] or not near[0]:
            return None
        names = ("value", *GREEKS, *GREEK_LISTS)
        alone = np.zeros(1, dtype=np.intp)
        return {name: np.abs(_matrix(told, name, alone) - _matrix(true, name, alone))[0] for name in names}

    def _told(self, rows: Rows, span: _Span) -> Prices | None:
        """Return rows of a span from polynomials through the rows around it; None where there are too few."""
        exercised = self.found.exercised[[span.low, span.high]]
        if exercised[0] != exercised[1]:
            return None
        good = self.priced & (self.found.status == "ok")
        every = self._through(rows, span, np.flatnonzero(good))
        alike = self._through(rows, span, np.flatnonzero(good & (self.found.exercised == exercised[0])))
        if every is None or alike is None:
            return None
        columns: dict[str, Any] = {"solves": np.zeros(rows.size, dtype=np.int64)}
        for name in ("value", *GREEKS, *GREEK_LISTS):
            error = "error" if name == "value" else error_of(name)
            known = _matrix(self.found, name, alike.nodes), _matrix(self.found, error, alike.nodes)
            missed = 0.0 if span.misfit is None else span.misfit[name]
            columns[name] = alike.weights @ known[0]
            columns[error] = _combined(alike.weights, known[1]) + missed
        for name in STILL_THERE:
            columns[name] = every.weights @ _matrix(self.found, name, every.nodes)
        if exercised[0]:
            columns["value"] = self.book.payoff()[rows]
        return _like(self.found.take(np.full(rows.size, span.low)), columns)

    def _through(self, rows: Rows, span: _Span, nodes: Rows) -> _Stencil | None:
        """Return the priced rows around a span, and what each counts for in the rows of the span."""
        x, first = np.unique(self.logarithms[nodes], return_index=True)
        if x.size < FEWEST_NODES:
            return None
        count = min(STENCIL, x.size)
        middle = 0.5 * (self.logarithms[span.low] + self.logarithms[span.high])
        start = max(0, min(int(np.searchsorted(x, middle)) - count // 2, x.size - count))
        x, diagonal = x[start : start + count], np.eye(count, dtype=bool)
        apart = x[:, None] - x + diagonal
        shares = (self.logarithms[rows][:, None, None] - x) / apart
        return _Stencil(nodes[first[start : start + count]], np.where(diagonal, 1.0, shares).prod(axis=2))


def _combined(weights: Matrix, errors: Matrix) -> Matrix:
    """Return the error of a weighted sum of numbers whose errors are alike, or have nothing to do with each other."""
    together: Matrix = np.maximum(np.abs(weights @ errors), np.sqrt(weights**2 @ errors**2))
    return together


def _like(neighbours: Prices, columns: dict[str, Any]) -> Prices:
    """Return prices that are those of neighbours but for some columns, matrices with a column per number of a list."""
    changed: dict[str, Any] = {}
    for name, numbers in columns.items():
        old = getattr(neighbours, name)
        if isinstance(old, Ragged):
            changed[name] = Ragged(old.first, numbers.ravel())
        else:
            changed[name] = numbers.reshape(old.shape)
    return replace(neighbours, **changed)


def _matrix(found: Prices, name: str, rows: Rows) -> Matrix:
    """Return a column of some rows, shape (n, 1), or (n, k) for lists of k numbers."""
    column = getattr(found, name)
    numbers = column.take(rows).values if isinstance(column, Ragged) else column[rows]
    return np.asarray(numbers.reshape(rows.size, -1))
