"""What the prices of a book have gained or lost between two tables of it, by causes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pricing_core.american.arrow.arrow_column import ArrowColumn, is_nested
from pricing_core.american.arrow.cells import number_array
from pricing_core.american.arrow.frames import Frame
from pricing_core.american.arrow.plain_types import plain_table
from pricing_core.american.arrow.price_batch import unusual
from pricing_core.american.arrow.schema import check_names, check_results, check_types, unread_columns
from pricing_core.american.book.book import Rows
from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.dates import read_moment
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.arrays import BoolVector
from pricing_core.batch.effects import EFFECTS, SAME_TIME, Contract, Side, effects_of, priced_side
from pricing_core.errors import InvalidInputError

PAIRS_AT_A_TIME = 32_768
PARTS = (*EFFECTS, "residual")
NUMBERS = ("price_before", "price_after", "profit_and_loss", *PARTS)
ABSENT = -1  # the row of a contract in the table that does not have it


@dataclass(frozen=True, slots=True, eq=False)
class Book:
    """One of the two tables that are compared.

    Parameters
    ----------
    table : pyarrow.RecordBatch
    malformed : mapping of int to InvalidInputError
        Rows that are not to be read, and why.
    """

    table: pa.RecordBatch
    malformed: Mapping[int, InvalidInputError] = field(default_factory=dict)

    def taken(self, rows: Rows) -> Book:
        """Return some rows."""
        faults = {
            place: self.malformed[row] for place, row in enumerate(rows.tolist()) if row in self.malformed
        }
        return Book(self.table.take(pa.array(rows)), faults)


def explain_profit_and_loss(
    before: Frame,
    after: Frame,
    *,
    key: str | Sequence[str] = "id",
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> pa.Table:
    """Explain what contracts have gained or lost between two tables, by full valuation of both.

    All amounts are money per unit of the underlying. With S, sigma, r, q the spot, volatility, rate and dividend yield,
    a change d of each from `before` to `after`, and all derivatives those of the contract in `before`:

    - delta_effect: delta * dS, and gamma_effect: gamma / 2 * dS**2. dS is the change of the spot with what it dropped
      by at the ex-times of `before` that have passed put back, because the price knew of these drops.
    - vega_effect: vega * d sigma; rho_effect: rho * dr. Where either table has a curve, the sum over its pieces of the
      derivative by the piece's value times its change at the same date.
    - theta_effect: theta * dt, with dt the time to expiry that has passed.
    - dividend_effect: dividend_rho * dq, likewise by pieces, with the changes of borrow_rate, foreign_rate and
      quanto_covariance where they are numbers; and, where the dividends still due are not those that
      `before` expected, what `before` would be worth with them, less its price.
    - exercise_effect: 0 unless S moves over the exercise boundary of `before`, or the contract has expired. Then the
      Taylor terms end at a kink: it is what `before` would be worth at the new S, less its price and the two terms in
      S. For an expired contract it is what exercise brings less its earlier price and the terms in S and t.
    - residual: profit_and_loss less all these. It is not spread over them. An exercise just before an ex-time that
      has passed, which would have been best, is in it.

    The parts add up to profit_and_loss exactly, as floating-point numbers and in any order: for that, all are rounded
    to a multiple of 2**-49 of the largest. For small moves of the spot alone the residual is of third order; terms of
    second order in other moves, and those in two moves at once, are in it.

    Parameters
    ----------
    before, after : pyarrow.Table, or any frame with the Arrow C stream interface
        Columns as in `price_table`, and those of the key.
    key : str or sequence of str
        Columns whose values, compared as text, tell which rows are one contract.
    tolerance, threads
        As in `price_many`.

    Returns
    -------
    pyarrow.Table
        A row for each of `before` in its order, then for those of `after` that have no partner: the key, the columns
        of `before` that do not describe contracts, "price_before", "price_after", "profit_and_loss", its parts,
        "status" and "message". The status is one of a price, or "only_before", "only_after", "missing_key",
        "duplicate_key", or "changed_contract" where option_type, strike, exercise, its times or start, dividend_model,
        underlying, settlement_lag or the expiration differ, or there is more time to expiry afterwards. Then there is
        no profit or loss, but prices there may be.

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt, of a type that cannot hold its values or named as a result is.

    Examples
    --------
    >>> terms = {"id": ["a"], "option_type": ["put"], "strike": [100.0], "rate": [0.05], "volatility": [0.2]}
    >>> before = pa.table({**terms, "spot": [100.0], "expiry": [1.0]})
    >>> after = pa.table({**terms, "spot": [101.0], "expiry": [1.0]})
    >>> found = explain_profit_and_loss(before, after).to_pylist()[0]
    >>> [round(found[name], 4) for name in ("profit_and_loss", "delta_effect", "gamma_effect", "residual")]
    [-0.3997, -0.4111, 0.0115, -0.0001]
    """
    settings = PricingSettings(tolerance)
    books = []
    for frame in (before, after):
        table = plain_table(frame)
        check_names(table.schema.names)
        check_types(table.schema)
        batches = table.combine_chunks().to_batches() or [pa.RecordBatch.from_pylist([], table.schema)]
        warn_of(unusual(batches[0], settings), callers=2)
        books.append(Book(pa.concat_batches(batches)))
    explanation = Explanation(books[0], books[1], key, settings, threads)
    return pa.Table.from_batches(explanation.rows(), explanation.schema)


class Explanation:
    """The rows of an explanation, made as they are asked for; arguments as of `explain_profit_and_loss`.

    Raises
    ------
    InvalidInputError
        A column of the key is missing, or a column is named as a result is.
    """

    def __init__(
        self,
        before: Book,
        after: Book,
        key: str | Sequence[str],
        settings: PricingSettings,
        threads: int | None,
    ) -> None:
        self._before, self._after, self._settings, self._threads = before, after, settings, threads
        keys = (key,) if isinstance(key, str) else tuple(key)
        for name in keys:
            for role, book in (("before", before), ("after", after)):
                if name not in book.table.schema.names:
                    raise InvalidInputError("key", name, f"a column of both tables; {role} has none")
                if is_nested(book.table.schema.field(name).type):
                    raise InvalidInputError("key", name, "a column of single values")
        if not keys:
            raise InvalidInputError("key", list(keys), "the name of at least one column")
        names = [name for name in before.table.schema.names if name not in keys]
        self._names = (*keys, *unread_columns(names))
        self._pairs, self._statuses = _joined(_keys(before.table, keys), _keys(after.table, keys))
        passed = [pa.field(name, self._type_of(name)) for name in self._names]
        check_results(self._names, [*NUMBERS, "status", "message"])
        self.schema = pa.schema(
            [
                *passed,
                *(pa.field(name, pa.float64()) for name in NUMBERS),
                *(pa.field(name, pa.string()) for name in ("status", "message")),
            ]
        )

    def rows(self) -> Iterator[pa.RecordBatch]:
        """Yield the rows in order, some at a time."""
        for start in range(0, len(self._statuses), PAIRS_AT_A_TIME):
            pairs = self._pairs[start : start + PAIRS_AT_A_TIME]
            yield self._some(pairs, self._statuses[start : start + PAIRS_AT_A_TIME])

    def _some(self, pairs: Rows, statuses: Sequence[str]) -> pa.RecordBatch:
        """Return the rows of some pairs."""
        columns = {name: np.full(len(pairs), np.nan) for name in NUMBERS}
        status, message = list(statuses), [_MESSAGES.get(word) for word in statuses]
        priced = np.array([word == "" for word in statuses], dtype=bool)
        places = np.flatnonzero(priced)
        if places.size:
            before = self._side(self._before.taken(pairs[places, 0]), "standard")
            after = self._side(self._after.taken(pairs[places, 1]), "none")
            words, reasons, sound = _statuses(before, after)
            for place, word, reason in zip(places.tolist(), words, reasons, strict=True):
                status[place], message[place] = word, reason
            effects = effects_of(before, after, sound, self._settings, self._threads)
            unknown = sound & np.isnan(effects.parts["residual"])
            for place in places[unknown].tolist():
                message[place] = "a derivative of the earlier price is not known"
            columns["price_before"][places] = before.result("price")
            columns["price_after"][places] = after.result("price")
            columns["profit_and_loss"][places] = effects.profit_and_loss
            for name, part in effects.parts.items():
                columns[name][places] = part
        for name, book, word, rows in (
            ("price_before", self._before, "only_before", pairs[:, 0]),
            ("price_after", self._after, "only_after", pairs[:, 1]),
        ):
            alone = np.flatnonzero([found == word for found in statuses])
            if alone.size:
                columns[name][alone] = self._side(book.taken(rows[alone]), "none").result("price")
        arrays = [self._passed(name, pairs) for name in self._names]
        arrays += [number_array(column) for column in columns.values()]
        arrays += [pa.array(cells, pa.string()) for cells in (status, message)]
        return pa.RecordBatch.from_arrays(arrays, schema=self.schema)

    def _side(self, book: Book, greeks: Greeks) -> Side:
        settings = replace(self._settings, greeks=greeks)
        return priced_side(book.table, settings, self._threads, book.malformed)

    def _type_of(self, name: str) -> pa.DataType:
        """Return the type of a column that passes through: text for a key of two types."""
        found: pa.DataType = self._before.table.schema.field(name).type
        other = self._after.table.schema
        is_key = name in self._names and name in other.names
        differs = is_key and other.field(name).type != found and not is_nested(found)
        return pa.string() if differs and not is_nested(other.field(name).type) else found

    def _passed(self, name: str, pairs: Rows) -> pa.Array:
        """Return a column of `before`, and of `after` where a contract is there alone."""
        kind = self.schema.field(name).type
        column = _taken(self._before.table.column(name), pairs[:, 0], kind)
        alone = pairs[:, 0] == ABSENT
        if not alone.any() or name not in self._after.table.schema.names:
            return column
        other = self._after.table.column(name)
        if other.type != kind and is_nested(kind):
            return column
        return pc.if_else(pa.array(alone), _taken(other, pairs[:, 1], kind), column)


_MESSAGES = {
    "only_before": "the other table has no contract of this key",
    "only_after": "the other table has no contract of this key",
    "missing_key": "the key is empty",
    "duplicate_key": "several rows of one table have this key",
}


def _keys(table: pa.RecordBatch, names: Sequence[str]) -> list[tuple[str, ...] | None]:
    """Return the key of each row as texts, None where a part of it is empty."""
    columns = []
    for name in names:
        column = table.column(name)
        if pa.types.is_floating(column.type):
            column = pc.if_else(pc.is_nan(column), None, column)
        try:
            text = pc.cast(column, pa.string())
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise InvalidInputError("key", name, "a column of text, numbers or dates") from None
        columns.append(pc.utf8_trim(text, " \t").to_pylist())
    return [key if all(key) else None for key in zip(*columns, strict=True)]


def _joined(
    before: Sequence[tuple[str, ...] | None], after: Sequence[tuple[str, ...] | None]
) -> tuple[Rows, list[str]]:
    """Return the rows of both tables that stand together, and what is wrong with them: "" for nothing."""
    counts = Counter(before), Counter(after)
    places = {key: place for place, key in enumerate(after)}
    pairs: list[tuple[int, int]] = []
    statuses: list[str] = []
    for row, key in enumerate(before):
        status = _status_of(key, counts[0], counts[1], "only_before")
        pairs.append((row, ABSENT if status else places[key]))
        statuses.append(status)
    for row, key in enumerate(after):
        status = _status_of(key, counts[1], counts[0], "only_after")
        if status:
            pairs.append((ABSENT, row))
            statuses.append(status)
    return np.array(pairs, dtype=np.intp).reshape(-1, 2), statuses


def _status_of(
    key: tuple[str, ...] | None,
    here: Mapping[tuple[str, ...] | None, int],
    there: Mapping[tuple[str, ...] | None, int],
    alone: str,
) -> str:
    if key is None:
        return "missing_key"
    if here[key] > 1 or there.get(key, 0) > 1:
        return "duplicate_key"
    return "" if key in there else alone


def _statuses(before: Side, after: Side) -> tuple[list[str], list[str | None], BoolVector]:
    """Return the status and the message of pairs, and which of them can be explained."""
    words = [side.results.column("status").to_pylist() for side in (before, after)]
    reasons = [side.results.column("message").to_pylist() for side in (before, after)]
    priced = [~np.isnan(side.result("price")) for side in (before, after)]
    changed = _changes(before, after)
    status: list[str] = []
    message: list[str | None] = []
    for row in range(len(words[0])):
        unpriced = [side for side in (0, 1) if not priced[side][row]]
        if unpriced:
            side = unpriced[0]
            status.append(words[side][row])
            message.append(f"{('before', 'after')[side]}: {reasons[side][row] or 'there is no price'}")
        elif changed[row]:
            status.append("changed_contract")
            message.append(changed[row])
        else:
            below = {words[0][row], words[1][row]} != {"ok"}
            status.append("tolerance_not_met" if below else "ok")
            message.append(None)
    return status, message, np.array([word in ("ok", "tolerance_not_met") for word in status], dtype=bool)


def _changes(before: Side, after: Side) -> list[str]:
    """Return what of a contract has changed that cannot change, in words; "" for nothing."""
    changes = [""] * before.expiry.size
    for name in ("option_type", "exercise", "dividend_model", "underlying"):
        for row, cells in _different_words(name, before, after):
            if cells[0] == "bermudan":  # it is European once its times have passed
                continue
            changes[row] = f"{name} was {cells[0]} and is {cells[1]}"
    for name in ("strike", "settlement_lag"):
        numbers = before.numbers(name), after.numbers(name)
        for row in np.flatnonzero(numbers[0] != numbers[1]).tolist():
            changes[row] = f"{name} was {numbers[0][row]:.12g} and is {numbers[1][row]:.12g}"
    for row in np.flatnonzero(after.expiry > before.expiry + SAME_TIME).tolist():
        changes[row] = (
            f"expiry was {before.expiry[row]:.12g} and is {after.expiry[row]:.12g}, longer than before"
        )
    if "expiration_date" in before.columns and "expiration_date" in after.columns:
        for row in range(len(changes)):
            old, new = (side.columns["expiration_date"].cell(row) for side in (before, after))
            if None not in (old, new) and _moment(old) != _moment(new):
                changes[row] = f"expiration_date was {old} and is {new}"
    for row in np.flatnonzero(_is_restricted(before) | _is_restricted(after)).tolist():
        if not changes[row] and not np.isnan(before.expiry[row] + after.expiry[row]):
            changes[row] = _other_exercise(before.contract(row), after.contract(row))
    return changes


def _is_restricted(side: Side) -> BoolVector:
    """Tell which contracts state when they may be exercised."""
    stated = np.zeros(side.expiry.size, dtype=bool)
    for name in ("exercise_times", "exercise_start"):
        if name in side.columns:
            stated |= ~side.columns[name].is_empty(None)
    return stated


def _other_exercise(before: Contract, after: Contract) -> str:
    """Return in words how the times of exercise differ from those that were left, "" if they do not."""
    elapsed = min(max(before[0].expiry - after[0].expiry, 0.0), before[0].expiry)
    if after[0].expiry == 0.0:
        return ""
    left, found = seen_later(*before, elapsed)[0], after[0]
    if left.exercise != found.exercise:
        return f"exercise was {before[0].exercise} and is {found.exercise}"
    old, new = (*left.exercise_times, left.exercise_start), (*found.exercise_times, found.exercise_start)
    if len(old) == len(new) and np.allclose(old, new, rtol=0.0, atol=SAME_TIME):
        return ""
    return f"exercise_times or exercise_start are not those of before, {elapsed:.12g} years later"


def _different_words(name: str, before: Side, after: Side) -> Iterable[tuple[int, tuple[object, object]]]:
    """Yield the rows in which a choice differs, with the two."""
    columns = [side.columns.get(name) for side in (before, after)]
    known = next((column for column in columns if column is not None), None)
    if known is None:
        return
    differ = np.zeros(before.expiry.size, dtype=bool)
    for word in known.field.choices:
        differ |= np.not_equal(*(_is_word(column, known, word, differ.size) for column in columns))
    for row in np.flatnonzero(differ).tolist():
        old, new = (known.field.default if column is None else column.cell(row) for column in columns)
        yield row, (old, new)


def _is_word(column: ArrowColumn | None, known: ArrowColumn, word: str, count: int) -> BoolVector:
    """Tell which cells hold a word; an empty cell, or one of no column, holds the default."""
    if column is None:
        return np.full(count, known.field.default == word)
    empty = column.is_empty(None) if known.field.default == word else np.zeros(count, dtype=bool)
    return np.asarray(column.is_word(word) | empty)


def _moment(cell: object) -> object:
    try:
        return read_moment("expiration_date", cell)
    except InvalidInputError:
        return cell


def _taken(column: pa.Array, rows: Rows, kind: pa.DataType) -> pa.Array:
    """Return some cells of a column, null where there is no row."""
    chosen = column.take(pa.array(rows, mask=rows == ABSENT))
    return chosen if chosen.type == kind else pc.cast(chosen, kind, safe=False)
