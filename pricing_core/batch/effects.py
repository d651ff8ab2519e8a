"""What a change of the market and the passing of time do to the price of a contract, by causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from pricing_core.american import LocalVolatility, Market, Option, PiecewiseConstant
from pricing_core.american.arrow.arrow_column import ArrowColumn
from pricing_core.american.arrow.cells import numbers_of
from pricing_core.american.arrow.price_batch import contract_columns, price_batch
from pricing_core.american.book.book import Rows
from pricing_core.american.book.columns import as_objects
from pricing_core.american.book.reading import checked_contract, read_book, read_columns
from pricing_core.american.contracts.curves import Curve, at, times_of
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.local_volatility import Volatility
from pricing_core.american.price_book import price_book
from pricing_core.american.price_many import as_arrays
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

EFFECTS = (
    "delta_effect",
    "gamma_effect",
    "vega_effect",
    "theta_effect",
    "rho_effect",
    "dividend_effect",
    "exercise_effect",
)
CURVES = {"rate": "rho", "dividend_yield": "dividend_rho", "volatility": "vega"}  # and their parallel Greeks
SAME_TIME = 1e-9  # years: a thirtieth of a second
TOLD_APART = 1e-10  # in a rate or a volatility
SPARE_BITS = 49  # of the 53 of a number: the sum of eight effects fits into the rest
Contract: TypeAlias = tuple[Option, Market]


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One of two tables with n contracts each: the contracts and their results.

    Parameters
    ----------
    contracts : pyarrow.RecordBatch, n rows
    columns : mapping of str to ArrowColumn
    expiry : Vector, shape (n,)
        Years, NaN where the contract is refused.
    results : pyarrow.RecordBatch, n rows
    """

    contracts: pa.RecordBatch
    columns: Mapping[str, ArrowColumn]
    expiry: Vector
    results: pa.RecordBatch

    def contract(self, row: int) -> Contract:
        """Return one contract."""
        return checked_contract({name: column.cell(row) for name, column in self.columns.items()})

    def numbers(self, name: str) -> Vector:
        """Return an input as numbers, NaN where it is a curve."""
        if name in self.columns:
            return self.columns[name].numbers()
        return np.zeros(self.expiry.size)

    def result(self, name: str) -> Vector:
        """Return a result as numbers, NaN for null."""
        return numbers_of(self.results.column(name))


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """The profit and loss of n pairs and its parts, NaN where they are not known.

    Parameters
    ----------
    profit_and_loss : Vector, shape (n,)
    parts : mapping of str to Vector, shape (n,)
        By the names in EFFECTS, and "residual" the last.
    """

    profit_and_loss: Vector
    parts: Mapping[str, Vector]


def priced_side(
    batch: pa.RecordBatch,
    settings: PricingSettings,
    threads: int | None,
    malformed: Mapping[int, InvalidInputError],
) -> Side:
    """Price the contracts and return them with their results."""
    columns = contract_columns(batch, settings)
    read = read_columns(columns, batch.num_rows, malformed)
    expiry = np.full(batch.num_rows, np.nan)
    expiry[read.rows] = read.book.expiry
    expiry[list(read.faults)] = np.nan
    results, _ = price_batch(batch, settings, threads, {**malformed, **read.faults})
    return Side(batch, columns, expiry, results)


def effects_of(
    before: Side, after: Side, chosen: BoolVector, settings: PricingSettings, threads: int | None
) -> Effects:
    """Return the parts of the profits and losses of some pairs, the others NaN; `explain_profit_and_loss` defines them.

    Parameters
    ----------
    chosen : bool array, shape (n,)
        The pairs that have both prices and are one contract.
    """
    elapsed = before.expiry - after.expiry
    repricing = _Repricing(before, replace(settings, greeks="none"), threads)
    events = _Events(
        before, after, elapsed, np.flatnonzero(chosen & _is_eventful(before, after)).tolist(), repricing
    )
    spot = events.spot
    move = spot - before.numbers("spot")
    parts = {
        "delta_effect": _term(before.result("delta"), move),
        "gamma_effect": _term(before.result("gamma"), 0.5 * move**2),
        "vega_effect": events.parallel("volatility"),
        "theta_effect": _term(before.result("theta"), elapsed),
        "rho_effect": events.parallel("rate"),
        "dividend_effect": events.parallel("dividend_yield") + events.dividends + _by_carry(before, after),
    }
    parts["exercise_effect"] = _exercise(before, after, chosen, parts, spot, repricing)
    profit = after.result("price") - before.result("price")
    for column in (profit, *parts.values()):
        column[~chosen] = np.nan
    return _summing_up(profit, parts)


def _by_carry(before: Side, after: Side) -> Vector:
    """Return what the changes of numbers do that add to the yield; those of curves are left to the residual."""
    change = np.zeros(before.expiry.size)
    for name, sign in (("borrow_rate", 1.0), ("quanto_covariance", 1.0), ("foreign_rate", -1.0)):
        change += sign * np.nan_to_num(after.numbers(name) - before.numbers(name))
    return _term(before.result("dividend_rho"), change)


class _Repricing:
    """Prices contracts of `before` again, with some inputs changed."""

    def __init__(self, before: Side, settings: PricingSettings, threads: int | None) -> None:
        self._before, self._settings, self._threads = before, settings, threads

    def at(self, rows: Rows, spots: Vector) -> pa.RecordBatch:
        """Return the results of some rows at other spots."""
        batch = self._before.contracts.take(pa.array(rows))
        place = batch.schema.get_field_index("spot")
        return price_batch(batch.set_column(place, "spot", pa.array(spots)), self._settings, self._threads)[0]

    def of(
        self, rows: Sequence[int], changes: Mapping[str, Sequence[Any]], greeks: Greeks = "none"
    ) -> dict[str, Any]:
        """Return the results of some rows with some columns replaced."""
        if not rows:
            return {}
        columns = {
            name: as_objects([column.cell(row) for row in rows])
            for name, column in self._before.columns.items()
        }
        columns |= {name: as_objects(cells) for name, cells in changes.items()}
        settings = replace(self._settings, greeks=greeks)
        read = read_book(columns, settings.tolerance)
        return as_arrays(price_book(read, columns, settings, self._threads))


class _Events:
    """What curves and dividends add: how pairs of contracts with either differ between the two tables.

    Parameters
    ----------
    elapsed : Vector, shape (n,)
        Years from one table to the other.
    rows : sequence of int
        Those with curves or dividends.
    """

    def __init__(
        self, before: Side, after: Side, elapsed: Vector, rows: Sequence[int], repricing: _Repricing
    ) -> None:
        self._before, self._after = before, after
        self.spot = after.numbers("spot")
        self.dividends = np.zeros(elapsed.size)
        self._by_curve: dict[str, dict[int, float]] = {name: {} for name in CURVES}
        pairs = {int(row): (before.contract(row), after.contract(row)) for row in rows}
        refined: dict[str, dict[int, PiecewiseConstant]] = {name: {} for name in CURVES}
        changed, local = [], []
        for row, (old, new) in pairs.items():
            years = max(float(elapsed[row]), 0.0)
            self.spot[row] = _with_past_dividends(new[1].spot, old[1], min(years, old[0].expiry))
            if not _same_dividends(old, new, years):
                changed.append(row)
            for name in CURVES:
                curves = getattr(old[1], name), getattr(new[1], name)
                if any(isinstance(curve, LocalVolatility) for curve in curves):
                    local.append(row)
                elif any(isinstance(curve, PiecewiseConstant) for curve in curves):
                    refined[name][row] = _refined(*curves, years, old[0].expiry)
                else:  # numbers, and curves of one value
                    change = np.array([curves[1] - curves[0]])
                    self._by_curve[name][row] = float(_term(before.result(CURVES[name])[row], change)[0])
        self._revalue_dividends(changed, pairs, elapsed, repricing)
        self._use_buckets(refined, pairs, elapsed, repricing)
        self._revalue_volatilities(local, pairs, elapsed, repricing)

    def parallel(self, name: str) -> Vector:
        """Return what the change of a rate, yield or volatility does, to first order."""
        change = self._after.numbers(name) - self._before.numbers(name)
        effect = _term(self._before.result(CURVES[name]), change)
        for row, value in self._by_curve[name].items():
            effect[row] = value
        return effect

    def _revalue_dividends(
        self,
        rows: Sequence[int],
        pairs: Mapping[int, tuple[Contract, Contract]],
        elapsed: Vector,
        repricing: _Repricing,
    ) -> None:
        """Price the earlier contracts with the dividends that the later ones still have."""
        changes: dict[str, list[Any]] = {"cash_dividends": [], "proportional_dividends": []}
        for row in rows:
            (old, new), years = pairs[row], max(float(elapsed[row]), 0.0)
            for name, cells in changes.items():
                amount = "amount" if name == "cash_dividends" else "fraction"
                past = [
                    (d.time, getattr(d, amount)) for d in getattr(old[1], name) if d.time <= years + SAME_TIME
                ]
                due = [
                    (d.time + years, getattr(d, amount)) for d in getattr(new[1], name) if d.time > SAME_TIME
                ]
                cells.append([{"time": time, amount: size} for time, size in past + due])
        kept = {name: cells for name, cells in changes.items() if any(cells) or name in self._before.columns}
        found = repricing.of(rows, kept)
        if rows:
            self.dividends[rows] = found["price"] - self._before.result("price")[rows]

    def _revalue_volatilities(
        self,
        rows: Sequence[int],
        pairs: Mapping[int, tuple[Contract, Contract]],
        elapsed: Vector,
        repricing: _Repricing,
    ) -> None:
        """Price the earlier contracts with the later volatilities, where either is a local one."""
        later = [_seen_before(pairs[row][1][1].volatility, max(float(elapsed[row]), 0.0)) for row in rows]
        found = repricing.of(rows, {"volatility": later})
        for place, row in enumerate(rows):
            self._by_curve["volatility"][row] = found["price"][place] - self._before.result("price")[row]

    def _use_buckets(
        self,
        refined: Mapping[str, Mapping[int, PiecewiseConstant]],
        pairs: Mapping[int, tuple[Contract, Contract]],
        elapsed: Vector,
        repricing: _Repricing,
    ) -> None:
        """Find the effect of each curve from the derivatives by its values on the pieces of both curves."""
        rows = sorted(set().union(*refined.values()))
        changes = {
            name: [found.get(row, getattr(pairs[row][0][1], name)) for row in rows]
            for name, found in refined.items()
        }
        results = repricing.of(rows, changes, "extended")
        for name, found in refined.items():
            for place, row in enumerate(rows):
                if row in found:
                    (_, old), (_, new) = pairs[row]
                    years = max(float(elapsed[row]), 0.0)
                    change = _change(getattr(old, name), getattr(new, name), years, found[row])
                    single = change.size == 1  # such a curve is a number, and has no buckets
                    slopes = [results[CURVES[name]][place]] if single else results[f"{name}_buckets"][place]
                    self._by_curve[name][row] = _product(change, slopes)


def _seen_before(volatility: Volatility, years: float) -> Volatility:
    """Return a volatility as a function of the years from an earlier time on."""
    if isinstance(volatility, LocalVolatility):
        return LocalVolatility(volatility.times + years, volatility.spots, volatility.values)
    if isinstance(volatility, PiecewiseConstant):
        return PiecewiseConstant(tuple(time + years for time in volatility.times), volatility.values)
    return volatility


def _product(change: Vector, slopes: Sequence[float]) -> float:
    """Return the sum of the products; NaN where there is not one of each, as of a contract without price."""
    return float(change @ np.array(slopes)) if len(slopes) == change.size else np.nan


def flags(results: pa.RecordBatch) -> BoolVector:
    """Return which contracts are exercised now; False for those without a price."""
    return np.array([bool(cell) for cell in results.column("exercise_now").to_pylist()], dtype=bool)


def _is_eventful(before: Side, after: Side) -> BoolVector:
    """Tell pairs with a curve or a dividend on either side."""
    eventful = np.zeros(before.expiry.size, dtype=bool)
    for side in (before, after):
        for name in CURVES:
            eventful |= np.isnan(side.numbers(name))
        for name in ("cash_dividends", "proportional_dividends"):
            if name in side.columns:
                eventful |= ~side.columns[name].is_empty("[]")
    return eventful


def _with_past_dividends(spot: float, market: Market, years: float) -> float:
    """Return a spot with what it has dropped by since, at ex-times up to `years`, put back."""
    cash = [(d.time, 0, d.amount) for d in market.cash_dividends if 0.0 < d.time <= years + SAME_TIME]
    shares = [
        (d.time, 1, d.fraction) for d in market.proportional_dividends if 0.0 < d.time <= years + SAME_TIME
    ]
    for _, is_share, size in sorted(cash + shares, reverse=True, key=lambda drop: (drop[0], -drop[1])):
        if not is_share:
            spot += size
        elif size < 1.0:
            spot /= 1.0 - size
    return spot


def _same_dividends(old: Contract, new: Contract, years: float) -> bool:
    """Tell whether the dividends still due are those that were expected."""
    for name, size in (("cash_dividends", "amount"), ("proportional_dividends", "fraction")):
        expected = [
            (d.time - years, getattr(d, size))
            for d in getattr(old[1], name)
            if d.time - years > SAME_TIME and d.time <= old[0].expiry + SAME_TIME
        ]
        due = [
            (d.time, getattr(d, size))
            for d in getattr(new[1], name)
            if SAME_TIME < d.time <= new[0].expiry + SAME_TIME
        ]
        if len(expected) != len(due) or any(
            abs(first - second) > SAME_TIME or amount != other
            for (first, amount), (second, other) in zip(sorted(expected), sorted(due), strict=True)
        ):
            return False
    return True


def _refined(old: Curve, new: Curve, years: float, expiry: float) -> PiecewiseConstant:
    """Return the earlier curve with knots where either of the two has one before expiry.

    Its values are moved by next to nothing, because pieces of one value would be taken for one piece.
    """
    knots = [time for time in times_of(old) if 0.0 < time < expiry]
    for time in (time + years for time in times_of(new)):
        if 0.0 < time < expiry and all(abs(time - knot) > SAME_TIME for knot in knots):
            knots.append(time)
    knots = [*sorted(knots), expiry or 1.0]
    starts = [0.0, *knots[:-1]]
    middles = [0.5 * (start + end) for start, end in zip(starts, knots, strict=True)]
    values = (at(old, middle) + TOLD_APART * (place % 2) for place, middle in enumerate(middles))
    return PiecewiseConstant(tuple(knots), tuple(values))


def _change(old: Curve, new: Curve, years: float, refined: PiecewiseConstant) -> Vector:
    """Return by how much each value of the refined curve has changed; what has passed counts as what comes next."""
    starts = [0.0, *refined.times[:-1]]
    middles = [0.5 * (start + end) for start, end in zip(starts, refined.times, strict=True)]
    late = [max(middle, years) for middle in middles]
    return np.array([at(new, time - years) - at(old, time) for time in late])


def _exercise(
    before: Side,
    after: Side,
    chosen: BoolVector,
    parts: Mapping[str, Vector],
    spot: Vector,
    repricing: _Repricing,
) -> Vector:
    """Return what the terms in the spot miss where it crosses the exercise boundary, or in spot and time at expiry."""
    effect = np.zeros(before.expiry.size)
    expired = chosen & (after.expiry == 0.0) & (before.expiry > 0.0)
    american = chosen & ~expired & before.columns["exercise"].is_word("american")
    rows = np.flatnonzero(american & (spot != before.numbers("spot")))
    terms = before.result("price") + parts["delta_effect"] + parts["gamma_effect"]
    if rows.size:
        moved = repricing.at(rows, spot[rows])
        crossed = flags(moved) != flags(before.results)[rows]
        effect[rows] = np.where(crossed, numbers_of(moved.column("price")) - terms[rows], 0.0)
    effect[expired] = (after.result("price") - terms - parts["theta_effect"])[expired]
    return effect


def _term(derivative: ArrayLike, change: Vector) -> Vector:
    """Return a term of a Taylor series; nothing changes where there is no change, whatever the derivative."""
    return np.where(change == 0.0, 0.0, np.asarray(derivative) * change)


def _summing_up(profit: Vector, parts: Mapping[str, Vector]) -> Effects:
    """Return the parts with what is left, all of them rounded to digits in which they add up exactly."""
    largest = np.abs(np.stack([profit, *parts.values()])).max(axis=0)
    with np.errstate(all="ignore"):
        _, exponent = np.frexp(largest)
        rounded = [
            np.ldexp(np.rint(np.ldexp(column, SPARE_BITS - exponent)), exponent - SPARE_BITS)
            for column in (profit, *parts.values())
        ]
    whole, *terms = rounded
    residual = whole - sum(terms)
    return Effects(whole, {**dict(zip(parts, terms, strict=True)), "residual": residual})
