"""Dates as times in years: actual days over 365, the time of day included."""

from __future__ import annotations

import datetime as dt
import re
from typing import TypeAlias, TypeGuard

import numpy as np

from pricing_core.american.contracts.fields import EXPIRY
from pricing_core.errors import InvalidInputError

AnyDate: TypeAlias = str | dt.date | np.datetime64
DAYS_PER_YEAR = 365.0
SECONDS_PER_YEAR = DAYS_PER_YEAR * 86_400.0
ISO_DATE = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?(Z|[+-]\d\d:\d\d)?)?",
    re.ASCII,
)
IN_WORDS = "an ISO date or date-time such as 2026-03-20 or 2026-03-20T16:00+01:00"


def year_fraction(start: object, end: object) -> float:
    """Return the years from `start` to `end`, ACT/365F: seconds / (365 * 86400); negative where end is earlier.

    Parameters
    ----------
    start, end : str, datetime.date, datetime.datetime or numpy.datetime64
        ISO 8601 in the extended form; a date without a time of day is its midnight. Both with a UTC offset or both
        without.

    Raises
    ------
    InvalidInputError
        One of them is no date, or only one of them has a UTC offset.

    Examples
    --------
    >>> year_fraction("2026-01-01", "2027-01-01")
    1.0
    >>> year_fraction("2026-03-01T00:00Z", "2026-03-01T12:00+12:00")
    0.0
    """
    return years_from(read_moment("start", start), "end", end)


def expiry_from_dates(valuation_date: object, expiration_date: object) -> float:
    """Return the time to expiry in years.

    Raises
    ------
    InvalidInputError
        As `year_fraction`; the expiration lies before the valuation, or more than 200 years after it.
    """
    years = years_from(read_moment("valuation_date", valuation_date), "expiration_date", expiration_date)
    if not EXPIRY.least <= years <= EXPIRY.most:
        allowed = f"at most {EXPIRY.most:g} years after valuation_date, and not before it"
        raise InvalidInputError("expiration_date", str(expiration_date), allowed)
    return years


def read_moment(field: str, value: object) -> dt.datetime:
    """Return a date or a date-time as a date-time, without offset or in UTC.

    Raises
    ------
    InvalidInputError
        It is neither; the message names `field`.
    """
    if isinstance(value, np.datetime64):
        value = value.astype("M8[us]").item()  # None, or a number, where there is no such date
    if isinstance(value, str) and ISO_DATE.fullmatch(value.strip(" \t")):
        value = _parsed(value.strip(" \t"))
    if isinstance(value, dt.date) and not isinstance(value, dt.datetime):
        value = dt.datetime(value.year, value.month, value.day)
    if not isinstance(value, dt.datetime):
        raise InvalidInputError(field, value, IN_WORDS)
    try:
        # Two times of one zone would be subtracted by the clock on the wall, over changes to summer time.
        return value if value.utcoffset() is None else value.astimezone(dt.UTC)
    except (OverflowError, ValueError):
        raise InvalidInputError(field, value, IN_WORDS) from None


def years_from(start: dt.datetime, field: str, date: object) -> float:
    """Return the years from `start`, as `read_moment` returns it, to a date.

    Raises
    ------
    InvalidInputError
        It is no date, or only one of the two has a UTC offset; the message names `field`.
    """
    end = read_moment(field, date)
    if (start.tzinfo is None) != (end.tzinfo is None):
        offset = "without" if start.tzinfo is None else "with"
        raise InvalidInputError(field, str(date), f"given {offset} a UTC offset, as the other dates are")
    return (end - start).total_seconds() / SECONDS_PER_YEAR


def moment_of_valuation(valuation_date: AnyDate | None) -> dt.datetime | None:
    """Return the valuation date, where there is one, as `read_moment` does.

    Raises
    ------
    InvalidInputError
        It is no date.
    """
    return None if valuation_date is None else read_moment("valuation_date", valuation_date)


def years_from_now(now: dt.datetime | None, field: str, date: AnyDate) -> float:
    """Return the years to a date from the valuation date, as `moment_of_valuation` returns it.

    Raises
    ------
    InvalidInputError
        There is no valuation date, or as in `years_from`; the message names `field`.
    """
    if now is None:
        allowed = "a number of years from now; a date where there is a valuation_date"
        raise InvalidInputError(field, date, allowed)
    return years_from(now, field, date)


def is_date(value: object) -> TypeGuard[AnyDate]:
    """Tell a date, or a text that may be one, from a number."""
    return isinstance(value, str | dt.date | np.datetime64)


def is_meant_as_date(value: object) -> bool:
    """Tell a date, or a text that starts as one, from a number and its text.

    Examples
    --------
    >>> [is_meant_as_date(value) for value in ("2026-13-01", dt.date(2026, 3, 20), "2026", "1e-05", 0.5)]
    [True, True, False, False, False]
    """
    if isinstance(value, str):
        return re.match(r"\s*\d{4}-", value) is not None
    return isinstance(value, dt.date | np.datetime64)


def _parsed(text: str) -> dt.datetime | str:
    """Return the date-time; the text where there is no such day or hour."""
    try:
        return dt.datetime.fromisoformat(text)
    except ValueError:
        return text
