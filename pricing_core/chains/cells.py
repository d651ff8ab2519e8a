"""Single cells of vendors' files as numbers, dates and words."""

from __future__ import annotations

import datetime as dt
import math
import re
from typing import Any

import numpy as np

from pricing_core.american.contracts.dates import ISO_DATE
from pricing_core.errors import InvalidInputError

MISSING = frozenset({"", "nan", "null", "none", "n/a", "na", "-", "--", "nat", "<na>"})
SIDES = {"c": "call", "call": "call", "calls": "call", "p": "put", "put": "put", "puts": "put"}
STYLES = {"a": "american", "american": "american", "e": "european", "european": "european"}
NUMBER = "a number with a decimal point"
DATE = "a date such as 2026-03-20 or 20260320"
MONTH_FIRST = "month/day/year"
LEAST_INTEGER_DATE, MOST_INTEGER_DATE = 19_000_101, 29_991_231


def is_missing(cell: object) -> bool:
    """Return whether a cell is empty, which may be said by a word or by NaN."""
    if isinstance(cell, str):
        return cell.strip().lower() in MISSING
    return cell is None or cell != cell  # noqa: PLR0124 - NaN, and NaT


def as_float(field: str, cell: object) -> float:
    """Return a cell as a number; NaN where it holds none.

    Raises
    ------
    InvalidInputError
        The cell is neither, for instance because it has a comma.
    """
    if is_missing(cell):
        return math.nan
    if isinstance(cell, bool) or not isinstance(cell, str | int | float | np.number):
        raise InvalidInputError(field, cell, NUMBER)
    if isinstance(cell, str) and ("," in cell or "_" in cell):
        raise InvalidInputError(field, cell, f"{NUMBER} and without commas")
    try:
        number = float(cell)
    except (ValueError, OverflowError):
        raise InvalidInputError(field, cell, NUMBER) from None
    if math.isinf(number):
        raise InvalidInputError(field, cell, "a finite number")
    return number


def as_moment(field: str, cell: object, form: str | None = None) -> dt.datetime | dt.date | None:
    """Return a date, or a date-time of the market's local time where a time of day is given.

    Parameters
    ----------
    form : {"month/day/year"}, optional
        How dates with strokes are to be read; they are refused unless it is stated.

    Raises
    ------
    InvalidInputError
        The cell is no date, or has an offset from UTC.
    """
    if is_missing(cell):
        return None
    if isinstance(cell, np.datetime64):
        cell = cell.astype("M8[us]").item()
    if isinstance(cell, dt.datetime):
        return _plain(field, cell)
    if isinstance(cell, dt.date):
        return cell
    if isinstance(cell, int | float | np.number) and not isinstance(cell, bool):
        cell = _digits(field, cell)
    text = str(cell).strip()
    try:
        found = _parsed(text, form)
    except ValueError:
        raise InvalidInputError(field, cell, DATE) from None
    return _plain(field, found) if isinstance(found, dt.datetime) else found


def as_choice(field: str, cell: object, words: dict[str, str]) -> str | None:
    """Return the choice that a cell's word stands for; None where it stands for none.

    Raises
    ------
    InvalidInputError
        It is none of the words.
    """
    if is_missing(cell):
        return None
    found = words.get(str(cell).strip().lower())
    if found is None:
        raise InvalidInputError(
            field, cell, " or ".join(f'"{word}"' for word in dict.fromkeys(words.values()))
        )
    return found


def as_text(cell: Any) -> str | None:
    """Return a text without blanks around it and without the caret of an index; None where the cell is empty."""
    return None if is_missing(cell) else str(cell).strip().lstrip("^")


def _digits(field: str, cell: Any) -> str:
    if not LEAST_INTEGER_DATE <= cell <= MOST_INTEGER_DATE or cell != int(cell):
        raise InvalidInputError(field, cell, DATE)
    return str(int(cell))


def _parsed(text: str, form: str | None) -> dt.datetime | dt.date:
    if re.fullmatch(r"\d{8}", text, re.ASCII):
        return dt.datetime.strptime(text, "%Y%m%d").date()
    if form == MONTH_FIRST and re.fullmatch(r"\d{1,2}/\d{1,2}/\d{4}", text, re.ASCII):
        return dt.datetime.strptime(text, "%m/%d/%Y").date()
    if not ISO_DATE.fullmatch(text):
        raise ValueError("no date")
    return dt.datetime.fromisoformat(text) if len(text) > 10 else dt.date.fromisoformat(text)


def _plain(field: str, moment: dt.datetime) -> dt.datetime | dt.date:
    """Return midnight as the date alone, as frames and files write dates."""
    if moment.tzinfo is not None:
        raise InvalidInputError(field, str(moment), "local time of the market, without a UTC offset")
    return moment.date() if moment.time() == dt.time() else moment
