"""Rates and dividends from files beside a chain."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.chains.canonical import RawTable
from pricing_core.chains.cells import as_float, as_moment, is_missing
from pricing_core.chains.raw_files import json_content, raw_table
from pricing_core.chains.vendor_map import plain_name
from pricing_core.errors import InvalidInputError, MissingInputError, Told

LARGEST_RATE = 0.4  # 1/year: a larger one looks like percent; chosen
PERCENT = "optionmetrics"  # the format whose zero curve has rates in percent


def read_rates(path: str, format_: str = "auto") -> Curve:
    """Return the curve of a file of rates.

    A .json file holds the curve as {"times": [...], "values": [...]}. A table has a column rate, 1/year, of zero rates,
    continuously compounded, and a column time (years) or days; between its times the forward rate is constant. With
    the format "optionmetrics" the rates are in percent; of several curve dates the last one counts.

    Raises
    ------
    InvalidInputError
        Columns are missing, times do not increase, or the rates look like percent.
    OSError
        The file cannot be read.
    """
    if path.lower().endswith(".json"):
        content = json_content(Path(path).read_text("utf-8"))
        if isinstance(content, Mapping) and set(content) == {"times", "values"}:
            return PiecewiseConstant(content["times"], content["values"])
    raw = raw_table(path)
    rows = _last_curve(raw)
    scale = 0.01 if format_ == PERCENT else 1.0
    times, zeros = [], []
    for row in rows:
        time, rate = _time(raw, row), scale * _number(raw, "rate", row)
        if abs(rate) > LARGEST_RATE:
            allowed = (
                "1/year, such as 0.05: it looks like percent (those of --format optionmetrics are read so)"
            )
            raise InvalidInputError(f"column rate, row {row + 1}", rate, allowed)
        times.append(time)
        zeros.append(rate)
    return _forward_curve(times, zeros)


def read_dividends(path: str) -> list[dict[str, Any]]:
    """Return the cash dividends of a file with columns ex_date, or time in years, and amount, money, None where empty.

    Raises
    ------
    InvalidInputError
        A column is missing, or a cell is no date or number.
    OSError
        The file cannot be read.
    """
    raw = raw_table(path)
    by_name = {plain_name(name): name for name in raw.columns}
    dated = by_name.get("exdate") or by_name.get("exdividenddate")
    if dated is None and "time" not in by_name:
        raise InvalidInputError(
            "dividends", Told("columns " + ", ".join(raw.columns)), "with ex_date or time"
        )
    found: list[dict[str, Any]] = []
    for row in range(raw.count):
        amount = None if _is_empty(raw, "amount", row) else _number(raw, "amount", row)
        if dated is None:
            found.append({"time": _number(raw, "time", row), "amount": amount})
            continue
        day = as_moment(f"ex_date, row {row + 1}", raw.columns[dated][row])
        if day is None:
            raise MissingInputError(f"ex_date, row {row + 1}")
        found.append({"ex_date": day, "amount": amount})
    return found


def _last_curve(raw: RawTable) -> list[int]:
    """Return the rows of the last curve date, of all where there is none."""
    name = next((name for name in raw.columns if plain_name(name) == "date"), None)
    rows = list(range(raw.count))
    if name is None:
        return rows
    dates = [as_moment("date", cell) for cell in raw.columns[name]]
    days = [date.date() if isinstance(date, dt.datetime) else date for date in dates]
    last = max((day for day in days if day is not None), default=None)
    return [row for row in rows if days[row] == last]


def _time(raw: RawTable, row: int) -> float:
    if any(plain_name(name) == "days" for name in raw.columns):
        return _number(raw, "days", row) / DAYS_PER_YEAR
    return _number(raw, "time", row)


def _is_empty(raw: RawTable, wanted: str, row: int) -> bool:
    name = next((name for name in raw.columns if plain_name(name) == wanted), None)
    return name is not None and is_missing(raw.columns[name][row])


def _number(raw: RawTable, wanted: str, row: int) -> float:
    name = next((name for name in raw.columns if plain_name(name) == wanted), None)
    if name is None:
        raise MissingInputError(f"column {wanted}", "a time may be a column days")
    if is_missing(raw.columns[name][row]):
        raise MissingInputError(f"column {wanted}, row {row + 1}")
    return as_float(f"column {wanted}, row {row + 1}", raw.columns[name][row])


def _forward_curve(times: list[float], zeros: list[float]) -> Curve:
    """Return the forward rates, constant between times, that zero rates mean."""
    if not times:
        raise InvalidInputError("rates", Told("no row"), "a table with at least one rate")
    grown = [0.0, *(time * zero for time, zero in zip(times, zeros, strict=True))]
    cuts = [0.0, *times]
    if any(late <= early for early, late in pairwise(cuts)):
        raise InvalidInputError("column time", times, "increasing, above 0")
    values = [(b - a) / (t - s) for (a, b), (s, t) in zip(pairwise(grown), pairwise(cuts), strict=True)]
    return PiecewiseConstant(tuple(times), tuple(values))
