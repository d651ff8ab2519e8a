"""Quotes as vendors deliver them, as one canonical table."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Callable
from typing import Any

import pyarrow as pa

from pricing_core.chains.canonical import COLUMNS, MESSAGE, NEEDED, RawTable, arrow_type
from pricing_core.chains.cells import SIDES, STYLES, as_choice, as_float, as_moment, as_text, is_missing
from pricing_core.chains.occ_symbol import read_occ_symbol
from pricing_core.chains.raw_files import raw_table
from pricing_core.chains.suspicious import check_units
from pricing_core.chains.vendor_map import Names, VendorMap, map_for, plain_name
from pricing_core.errors import InvalidInputError, MissingInputError, enumerated

FROM_SYMBOL = ("underlying_symbol", "expiration", "strike", "option_type")
Cells = dict[str, list[Any]]


def read_chain(
    source: Any,
    format: str = "auto",  # noqa: A002
    underlying_price: float | None = None,
    quote_date: object = None,
) -> pa.Table:
    """Read quotes from a vendor's file, or a table with its columns, into the canonical columns.

    Parameters
    ----------
    source : str, path, pyarrow.Table, frame, mapping of columns, or list of records
        A .csv (also .gz, .zst), .json or .parquet file, or its content; other columns pass through.
    format : str
        "auto", or the name of a vendor's map: "generic", "openbb", "cboe", "optionmetrics", "orats", "polygon",
        "tradier", "yfinance", "thetadata", "ibkr", "optionsdx".
    underlying_price : float, optional
        Money, for files that lack it.
    quote_date : str, date or datetime, optional
        In local time of the market, for files that lack it.

    Returns
    -------
    pyarrow.Table
        The canonical columns, the other columns of the file, and "message", which says of a row that could not be
        read why; null for the others. Rows in order; those of files with call and put in one row are two each.

    Raises
    ------
    InvalidInputError
        The file is no table of quotes, lacks a column, or a column as a whole looks like percent, cents, thousandths
        or the other side; the message names the first such row.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> quotes = {"symbol": ["X"], "date": ["2026-01-02"], "expiry": ["2026-03-20"], "type": ["P"], "strike": [90.0]}
    >>> table = read_chain({**quotes, "bid": [2.0], "ask": [2.1]}, underlying_price=95.0)
    >>> table["option_type"].to_pylist(), table["expiration"].to_pylist()
    (['put'], [datetime.date(2026, 3, 20)])
    """
    return read_raw(raw_table(source), format, underlying_price, quote_date, str)


def read_raw(
    raw: RawTable,
    format_: str,
    underlying_price: float | None,
    quote_date: object,
    told: Callable[[InvalidInputError], str],
) -> pa.Table:
    """Return the canonical table of raw columns, as `read_chain` does.

    Parameters
    ----------
    told : callable
        Returns what the column "message" says of a fault.
    """
    map_ = map_for(format_, list(raw.columns))
    cells, others, faults = _long_form(raw, map_)
    _fill(cells, {"underlying_price": underlying_price, "quote_date": quote_date})
    count = raw.count * (2 if map_.is_wide else 1)
    _check_present(cells, map_)
    table = _Reading(cells, count, faults, map_, told).table()
    for name, column in others.items():
        table = table.append_column(name, column)
    table = table.append_column(MESSAGE, pa.array([faults.get(row) for row in range(count)], pa.string()))
    check_units(table)
    return table


class _Reading:
    """The cells of the canonical columns turned into values; what cannot be is a fault of its row."""

    def __init__(
        self,
        cells: Cells,
        count: int,
        faults: dict[int, str],
        map_: VendorMap,
        told: Callable[[InvalidInputError], str],
    ) -> None:
        self._cells, self._count, self._faults, self._map, self._told = cells, count, faults, map_, told

    def table(self) -> pa.Table:
        """Return all canonical columns."""
        read = {name: self._column(name, kind) for name, kind in COLUMNS.items()}
        if "contract_symbol" in self._cells:
            self._take_from_symbols(read)
        for name in NEEDED[:-2]:
            for row, value in enumerate(read[name]):
                if (value is None) and row not in self._faults:
                    self._faults[row] = f"{name} is missing"
        columns = {}
        for name, kind in COLUMNS.items():
            times = any(isinstance(value, dt.datetime) for value in read[name]) and kind == "moment"
            columns[name] = pa.array(
                [_at_midnight(value) for value in read[name]] if times else read[name],
                arrow_type(kind, with_time=times),
            )
        return pa.table(columns)

    def _column(self, name: str, kind: str) -> list[Any]:
        cells = self._cells.get(name)
        if cells is None:
            return [None] * self._count
        parse = self._parser(name, kind)
        values: list[Any] = [None] * self._count
        for row, cell in enumerate(cells):
            try:
                values[row] = parse(cell)
            except InvalidInputError as fault:
                self._faults.setdefault(row, self._told(fault))
        return values

    def _parser(self, name: str, kind: str) -> Callable[[Any], Any]:
        if kind == "number":
            scale, zero = self._map.scale.get(name, 1.0), name in self._map.zero_is_missing

            def number(cell: Any) -> float | None:
                value = as_float(name, cell) / scale
                return None if math.isnan(value) or (zero and value == 0.0) else value

            return number
        if kind == "moment":
            return lambda cell: as_moment(name, cell, self._map.dates)
        if kind == "date":
            return lambda cell: _as_date(as_moment(name, cell, self._map.dates))
        if kind in ("option_type", "exercise"):
            words = SIDES if kind == "option_type" else STYLES
            return lambda cell: as_choice(name, cell, words)
        return as_text

    def _take_from_symbols(self, read: dict[str, list[Any]]) -> None:
        """Fill what columns lack from the OCC symbols, and refuse rows that say something else than theirs."""
        for row, symbol in enumerate(read["contract_symbol"]):
            if symbol is None or row in self._faults:
                continue
            try:
                found = read_occ_symbol(symbol)
            except InvalidInputError as fault:
                if any(read[name][row] is None for name in FROM_SYMBOL[1:]):
                    self._faults[row] = self._told(fault)
                continue
            said = (found.root, found.expiration, found.strike, found.option_type)
            for name, value in zip(
                ("underlying_symbol", "expiration", "strike", "option_type"), said, strict=True
            ):
                if read[name][row] is None:
                    read[name][row] = value
            if read["option_type"][row] != found.option_type:
                self._faults[row] = (
                    f"option_type is {read['option_type'][row]}, but contract_symbol says {found.option_type}"
                )


def _long_form(raw: RawTable, map_: VendorMap) -> tuple[Cells, dict[str, pa.Array], dict[int, str]]:
    """Return the cells of the canonical columns, one option per row, the other columns and the faults."""
    by_name = {plain_name(name): name for name in raw.columns}
    shared, used = _picked(raw, by_name, map_.columns)
    for name, choices in map_.mean.items():
        if (mean := _mean(raw, by_name, choices, map_)) is not None:
            shared[name] = mean
    faults = dict(raw.faults)
    if map_.is_wide:
        call, of_call = _picked(raw, by_name, map_.call)
        put, of_put = _picked(raw, by_name, map_.put)
        used |= of_call | of_put
        nothing: list[Any] = [None] * raw.count
        cells = {name: _woven(column, column) for name, column in shared.items()}
        cells |= {
            name: _woven(call.get(name, nothing), put.get(name, nothing))
            for name in dict.fromkeys([*call, *put])
        }
        cells["option_type"] = ["call", "put"] * raw.count
        faults = {2 * row + side: fault for row, fault in faults.items() for side in (0, 1)}
    else:
        cells = shared
    others = {
        name: _passed_on(_woven(column, column) if map_.is_wide else column)
        for name, column in raw.columns.items()
        if name not in used and name not in COLUMNS and name != MESSAGE
    }
    return cells, others, faults


def _picked(raw: RawTable, by_name: dict[str, str], names: Names) -> tuple[Cells, set[str]]:
    """Return the best column that there is for each canonical one, and the names of these."""
    cells: Cells = {}
    used: set[str] = set()
    for name, choices in names.items():
        found = next(
            (
                by_name[plain_name(choice)]
                for choice in choices
                if by_name.get(plain_name(choice)) not in (None, *used)
            ),
            None,
        )
        if found is not None:
            cells[name] = raw.columns[found]
            used.add(found)
    return cells, used


def _mean(raw: RawTable, by_name: dict[str, str], choices: Any, map_: VendorMap) -> list[Any] | None:
    """Return the mean of the first columns that are all there."""
    for names in choices:
        found = [by_name.get(plain_name(name)) for name in names]
        if None not in found:
            rows = zip(*(raw.columns[str(name)] for name in found), strict=True)
            return [_mean_of(row) for row in rows]
    return None


def _mean_of(cells: tuple[Any, ...]) -> float | None:
    try:
        numbers = [as_float("underlying_price", cell) for cell in cells]
    except InvalidInputError:
        return None
    numbers = [number for number in numbers if number > 0.0]
    return math.fsum(numbers) / len(numbers) if numbers else None


def _woven(first: list[Any], second: list[Any]) -> list[Any]:
    return [cell for pair in zip(first, second, strict=True) for cell in pair]


def _passed_on(column: list[Any]) -> pa.Array:
    """Return a column that is not read, as text where its cells are of several types."""
    try:
        return pa.array(column)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if cell is None else str(cell) for cell in column], pa.string())


def _fill(cells: Cells, given: dict[str, object]) -> None:
    """Put what is given in the place of columns that are missing, or of their empty cells."""
    count = len(next(iter(cells.values()), []))
    for name, value in given.items():
        if value is not None:
            column = cells.get(name, [None] * count)
            cells[name] = [value if is_missing(cell) else cell for cell in column]
    if (
        given["underlying_price"] is not None
        and not as_float("underlying_price", given["underlying_price"]) > 0.0
    ):
        raise InvalidInputError("underlying_price", given["underlying_price"], "a number above 0")
    as_moment("quote_date", given["quote_date"])


def _check_present(cells: Cells, map_: VendorMap) -> None:
    from_symbol = FROM_SYMBOL if "contract_symbol" in cells else ()
    missing = [name for name in NEEDED if name not in cells and name not in from_symbol]
    if missing:
        given = [name for name in missing if name in ("underlying_price", "quote_date")]
        hint = f"; {enumerated(given)} may be given beside the file" if given else ""
        raise MissingInputError(dict.fromkeys(missing, ""), f"the table was read as {map_.name}{hint}")


def _as_date(moment: dt.datetime | dt.date | None) -> dt.date | None:
    return moment.date() if isinstance(moment, dt.datetime) else moment


def _at_midnight(value: dt.datetime | dt.date | None) -> dt.datetime | None:
    if value is None or isinstance(value, dt.datetime):
        return value
    return dt.datetime(value.year, value.month, value.day)
