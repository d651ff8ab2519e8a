"""Derivatives by the market's parameters: differences of the prices of bumped contracts.

The prices must be smooth in what is bumped, so that an engine solves all of them alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import CURVES, Book, Listed, Rows
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.ragged import Ragged, starts
from pricing_core.american.book.segments import SAME_TIME
from pricing_core.arrays import BoolVector, Vector

VOLATILITY_SHARE = 0.005  # Step of a volatility as a share of the contract's smallest one; calibrated.
# Step of a rate or yield, 1/year, up to one year of life; beyond, that over the years; calibrated.
RATE_STEP = 1e-3
# Step of a cash dividend as a share of the spot, or of the strike where that is 0; calibrated.
AMOUNT_STEP = 1e-3
AMOUNT_SHARE = 0.2  # Largest step of a cash dividend as a share of its amount; chosen.
# Smallest step of the volatility, 1/sqrt(year), whose square does not vanish; chosen.
SMALLEST_VOLATILITY_STEP = 1e-100
SMALLEST_RATE_STEP = 1e-5  # Smallest step of a rate or yield, 1/year; chosen above rounding.
# Step of a parameter for exact derivatives, in its own unit up to one year of life, in strikes for dividends; chosen.
DIRECTION_STEP = 1e-4
PARALLEL = {"volatility": "vega", "rate": "rho", "dividend_yield": "dividend_rho"}
BUCKETS = {name: f"{name}_buckets" for name in CURVES}
DIVIDENDS, STICKY = "dividend_sensitivities", "delta_sticky_moneyness"


class _Term(NamedTuple):
    """Bumped contracts, and what their values count for in one kind of derivative.

    `entry` is the place in the derivative's column; `by_delta` tells that deltas count instead of values.
    """

    kind: str
    entry: NDArray[np.int64]
    weight: Vector
    contract: NDArray[np.int64]
    by_delta: bool = False


@dataclass(frozen=True, slots=True)
class Differences:
    """The contracts to be priced for all derivatives of a book, and how their prices make these.

    Parameters
    ----------
    book : Book
        k contracts.
    row : int array, shape (k,)
        The contract of the original book that each was made from.
    """

    book: Book
    row: Rows
    _terms: tuple[_Term, ...]
    _sizes: dict[str, int]
    _listed: Listed

    def columns(self, value: Vector, delta: Vector) -> dict[str, Any]:
        """Return the derivatives as columns of `Prices`.

        Parameters
        ----------
        value, delta : Vector, shape (k,)
            Money; NaN leaves the derivatives NaN that need it.
        """
        return self._sums(value, delta, np.positive)

    def noise(self, error: Vector) -> dict[str, Any]:
        """Return what errors of the values, money, shape (k,), may add up to in the columns."""
        return self._sums(error, error, np.abs)

    def _sums(self, value: Vector, delta: Vector, weighted: Callable[[Vector], Vector]) -> dict[str, Any]:
        found: dict[str, Any] = {kind: np.zeros(size) for kind, size in self._sizes.items()}
        for term in self._terms:
            what = (delta if term.by_delta else value)[term.contract]
            found[term.kind] += np.bincount(term.entry, weighted(term.weight) * what, found[term.kind].size)
        for name in CURVES:
            if BUCKETS[name] in found:
                found[BUCKETS[name]] = Ragged(getattr(self._listed, name).first, found[BUCKETS[name]])
        found[DIVIDENDS] = Ragged(self._listed.cash_dividends.first, found[DIVIDENDS])
        return found


class _Plan:
    """Collects bumped contracts and terms."""

    def __init__(self) -> None:
        self.books: list[Book] = []
        self.rows: list[Rows] = []
        self.terms: list[_Term] = []
        self.count = 0

    def add(self, book: Book, rows: Rows) -> NDArray[np.int64]:
        """Take contracts made from `rows` in; return their places."""
        self.books.append(book)
        self.rows.append(rows)
        self.count += rows.size
        return np.arange(self.count - rows.size, self.count)

    def central(
        self, kind: str, bumped: Bump, rows: Rows, entry: Rows, step: Vector
    ) -> list[NDArray[np.int64]]:
        """Add the difference of second order around the contract; return the places of up and down."""
        places = []
        for side in (1.0, -1.0):
            places.append(self.add(bumped(side * step), rows))
            self.terms.append(_Term(kind, entry, side * 0.5 / step, places[-1]))
        return places

    def forward(self, kind: str, bumped: Bump, rows: Rows, entry: Rows, step: Vector) -> None:
        """Add the one-sided difference of second order."""
        for steps, weight in ((0.0, -1.5), (1.0, 2.0), (2.0, -0.5)):
            place = self.add(bumped(steps * step), rows)
            self.terms.append(_Term(kind, entry, weight / step, place))


class Bump:
    """Contracts with one number of each shifted."""

    def __init__(self, book: Book, name: str, where: BoolVector | None = None) -> None:
        self.book, self.name, self.where = book, name, where

    def __call__(self, by: Vector) -> Book:
        """Return the contracts, shifted by so much each, shape (n,); no limit of the market is checked."""
        shift = self.book.per_segment(by)
        column = getattr(self.book.segments, self.name)
        column = column + (shift if self.where is None else np.where(self.where, shift, 0.0))
        return replace(self.book, segments=replace(self.book.segments, **{self.name: column}))


def plan_differences(book: Book, *, extended: bool, share: float = 1.0) -> Differences:
    """Return what must be priced for vega, rho, dividend rho and the dividend sensitivities of every contract.

    Parameters
    ----------
    extended : bool
        Whether vanna, volga and the buckets of curves are wanted as well.
    share : float
        Multiplies all steps.
    """
    plan, everyone = _Plan(), np.arange(book.count)
    steps = _steps(book, share)
    up, down = plan.central("vega", Bump(book, "volatility"), everyone, everyone, steps["volatility"])
    if extended:
        step = steps["volatility"]
        same = plan.add(book, everyone)
        for place, weight in ((up, 1.0), (same, -2.0), (down, 1.0)):
            plan.terms.append(_Term("volga", everyone, weight / step**2, place))
        for place, weight in ((up, 0.5), (down, -0.5)):
            plan.terms.append(_Term("vanna", everyone, weight / step, place, by_delta=True))
    for name in ("rate", "dividend_yield"):
        # Below zero exercise is another matter, so that a rate next to it is bumped upward only.
        smallest = smallest_of(book, getattr(book.segments, name))
        upward = (smallest >= 0.0) & (smallest < steps[name])
        for rows, difference in ((everyone[~upward], plan.central), (everyone[upward], plan.forward)):
            if rows.size:
                difference(PARALLEL[name], Bump(book.take(rows), name), rows, rows, steps[name][rows])
    _by_dividends(plan, book, share)
    sizes = dict.fromkeys(PARALLEL.values(), book.count)
    sizes[DIVIDENDS] = book.listed.cash_dividends.values.size
    if extended:
        _by_pieces(plan, book, steps)
        sizes |= {"vanna": book.count, "volga": book.count}
        sizes |= {BUCKETS[name]: getattr(book.listed, name).values.size for name in CURVES}
    bumped = Book.concatenated(plan.books)
    return Differences(bumped, np.concatenate(plan.rows), tuple(plan.terms), sizes, book.listed)


class PlannedDirection(NamedTuple):
    """The derivative `entry` of the column `kind` of `Prices`, and the contract with a step more and a step less."""

    kind: str
    entry: int
    sides: tuple[Book, Book]
    step: float


def plan_directions(book: Book, *, extended: bool, only: str = "") -> list[PlannedDirection]:
    """Return the first derivatives of one contract by every parameter, or those of the one kind that is wanted.

    The bumped contracts are cut like the contract itself; nothing where a derivative asks for a further cut. Their
    steps are small, for numbers that are differentiated exactly.
    """
    shifts: list[tuple[str, int, str, BoolVector | None]] = [
        (PARALLEL[name], 0, name, None) for name in CURVES
    ]
    ends, expiry = book.segments.end, book.expiry.item(0)
    for entry, time in enumerate(book.listed.cash_dividends.values.tolist()):
        if SAME_TIME * expiry < time <= expiry:
            where = np.abs(ends - time) <= SAME_TIME * expiry
            if not where.any():
                return []
            shifts.append((DIVIDENDS, entry, "due", where))
    if extended:
        middle = 0.5 * (book.segments.start + ends)
        for name in CURVES:
            for entry, _, start, end in _pieces(getattr(book.listed, name), book.expiry):
                if end < expiry * (1.0 - SAME_TIME) and np.abs(ends - end).min() > SAME_TIME * expiry:
                    return []
                shifts.append((BUCKETS[name], entry, name, (middle > start) & (middle < end)))
    planned = []
    for kind, entry, name, where in shifts:
        if only and kind != only:
            continue
        step = DIRECTION_STEP * (book.strike.item(0) if name == "due" else 1.0 / max(expiry, 1.0))
        bumped = Bump(book, name, where)
        sides = bumped(np.array([step])), bumped(np.array([-step]))
        planned.append(PlannedDirection(kind, entry, sides, step))
    return planned


def of_dividends_not_due(book: Book) -> Ragged:
    """Return 0 for every cash dividend of contracts none of whose dividends falls due before expiry.

    The list of a contract that has one, whose amount is next to nothing, stays empty.
    """
    listed = book.listed.cash_dividends
    if listed.values.size == 0:
        return listed
    owner = listed.owner()
    due = (listed.values > 0.0) & (listed.values <= book.expiry[owner])
    counts = np.where(np.bincount(owner[due], minlength=book.count) > 0, 0, listed.counts())
    return Ragged(starts(counts), np.zeros(int(counts.sum())))


def unchanged(book: Book, *, extended: bool) -> dict[str, Any]:
    """Return the derivatives of contracts whose value no parameter changes as columns of `Prices`."""
    listed, names = book.listed, [*PARALLEL.values(), *(("vanna", "volga") if extended else ())]
    columns: dict[str, Any] = {name: np.zeros(book.count) for name in names}
    lists = {DIVIDENDS: listed.cash_dividends}
    if extended:
        lists |= {BUCKETS[name]: getattr(listed, name) for name in CURVES}
    return columns | {
        name: Ragged(column.first, np.zeros(column.values.size)) for name, column in lists.items()
    }


def stored(columns: dict[str, Any], rows: Rows, found: dict[str, Any]) -> dict[str, Any]:
    """Return the columns with the rows found elsewhere put in."""
    put: dict[str, Any] = {}
    for name, column in columns.items():
        if isinstance(column, Ragged):
            put[name] = column.replaced(rows, found[name])
        else:
            put[name] = column.copy()
            put[name][rows] = found[name]
    return put


def _steps(book: Book, share: float) -> dict[str, Vector]:
    """Return the step of each parameter, shape (n,)."""
    volatility = book.segments.volatility
    smallest = smallest_of(book, np.where(volatility > 0.0, volatility, np.inf))
    rate = share * RATE_STEP / np.maximum(book.expiry, 1.0)
    # With a rate or a yield below 0 exercise is another matter on either side of r = q.
    lower = np.minimum(book.segments.rate, book.segments.dividend_yield)
    between = np.abs(book.segments.rate - book.segments.dividend_yield)
    closest = np.maximum(0.5 * smallest_of(book, between), SMALLEST_RATE_STEP)
    rate = np.where(smallest_of(book, lower) < 0.0, np.minimum(rate, closest), rate)
    volatility_step = share * VOLATILITY_SHARE * np.where(np.isfinite(smallest), smallest, 1.0)
    volatility_step = np.maximum(volatility_step, SMALLEST_VOLATILITY_STEP)
    return {"volatility": volatility_step, "rate": rate, "dividend_yield": rate}


def smallest_of(book: Book, column: Vector) -> Vector:
    """Return the smallest number of a column of segments for each contract, shape (n,)."""
    return np.minimum.reduceat(column, book.first[:-1])


def _by_dividends(plan: _Plan, book: Book, share: float) -> None:
    """Add a difference for each cash dividend that falls due by expiry."""
    listed = book.listed.cash_dividends
    if listed.values.size == 0:
        return
    owner, time = listed.owner(), listed.values
    expiry = book.expiry[owner]
    entry = np.flatnonzero((time > SAME_TIME * expiry) & (time <= expiry))
    if entry.size == 0:
        return
    rows, time, expiry = owner[entry], time[entry], expiry[entry]
    cut = with_cuts(book.take(rows), Ragged(np.arange(rows.size + 1), time))
    ends, places = cut.segments.end, cut.per_segment(np.arange(rows.size))
    here = np.abs(ends - time[places]) <= SAME_TIME * expiry[places]
    at = np.flatnonzero(here)
    due = cut.segments.due[at]
    spot = book.spot[rows]
    step = share * AMOUNT_STEP * np.where(spot > 0.0, spot, book.strike[rows])
    for paid, difference in ((due > 0.0, plan.central), (due <= 0.0, plan.forward)):
        chosen = np.flatnonzero(paid)
        if chosen.size:
            part = cut.take(chosen)
            where = np.zeros(part.segments.end.size, dtype=bool)
            where[at[chosen] - cut.first[chosen] + part.first[:-1]] = True
            size = np.where(due > 0.0, np.minimum(step, AMOUNT_SHARE * due), step)[chosen]
            difference(DIVIDENDS, Bump(part, "due", where), rows[chosen], entry[chosen], size)


def _by_pieces(plan: _Plan, book: Book, steps: dict[str, Vector]) -> None:
    """Add a difference for each piece of each curve that holds at some time before expiry."""
    for name in CURVES:
        times = getattr(book.listed, name)
        for entry, row, start, end in _pieces(times, book.expiry):
            rows = np.array([row])
            part = with_cuts(book.take(rows), Ragged.of([times.row(row)]))
            middle = 0.5 * (part.segments.start + part.segments.end)
            where = (middle > start) & (middle < end)
            step = steps[name][rows]
            value = getattr(part.segments, name)[where].min(initial=np.inf)
            upward = name != "volatility" and 0.0 <= value < step[0]
            difference = plan.forward if upward else plan.central
            difference(BUCKETS[name], Bump(part, name, where), rows, np.array([entry]), step)


def _pieces(times: Ragged, expiry: Vector) -> Iterator[tuple[int, int, float, float]]:
    """Yield (entry, row, start, end) of the pieces of curves that begin before expiry; the last one has no end."""
    for row in np.flatnonzero(times.counts()).tolist():
        ends = times.row(row)
        starts = (0.0, *ends[:-1])
        for k, (start, end) in enumerate(zip(starts, (*ends[:-1], np.inf), strict=True)):
            if start < expiry[row]:
                yield int(times.first[row]) + k, row, start, end
