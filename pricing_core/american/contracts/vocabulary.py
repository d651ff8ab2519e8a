"""From the flat vocabulary, one value per name as in JSON or a row of a table, to an option and its market."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.dates import expiry_from_dates, read_moment, years_from
from pricing_core.american.contracts.fields import (
    BORROW_RATE,
    CONTRACT_FIELDS,
    DIVIDEND_MODEL,
    DIVIDEND_YIELD,
    EX_TIME,
    EXERCISE,
    EXERCISE_START,
    EXPIRY,
    QUANTO_COVARIANCE,
    SETTLEMENT_LAG,
    UNDERLYING,
    input_field,
)
from pricing_core.american.contracts.json_text import parse_cell
from pricing_core.american.contracts.local_volatility import Volatility, read_volatility
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.names import unknown_names
from pricing_core.errors import InvalidInputError

NAMES = tuple(field.name for field in CONTRACT_FIELDS)
# Fields with a default that a value of None or NaN does not stand for: it may be the trace of a fault.
DEFAULTS = {field.name: field.default for field in (EXERCISE, DIVIDEND_YIELD)}
REQUIRED = tuple(field.name for field in CONTRACT_FIELDS if field.required and field is not EXPIRY)
OPTIONAL = tuple(name for name in NAMES if name not in REQUIRED and name not in DEFAULTS)
DATES = tuple(field.name for field in CONTRACT_FIELDS if field.kind == "date")
LISTS = tuple(field.name for field in CONTRACT_FIELDS if field.kind == "list")
DATE_KINDS = (str, dt.date, np.datetime64)  # Types of dates; a number is none.


def contract_from(contract: Mapping[str, Any]) -> tuple[Option, Market]:
    """Return the option and the market that one flat mapping describes.

    Parameters
    ----------
    contract : mapping of str to object
        By the names of `Option` and `Market`, and these:

        - valuation_date and expiration_date, as `year_fraction` takes them, in the place of expiry;
        - with them, ex_date in the place of a dividend's time: without a time of day the start of that day. A
          dividend before the valuation date has gone from the spot already, as one at time 0;
        - with them, dates among exercise_times and as exercise_start; a start before the valuation date is 0.

        Lists and curves may be JSON text. None, NaN and blank text stand for an optional value that is not given.

    Raises
    ------
    InvalidInputError
        A value is missing, unknown or outside what is allowed; the message names it, as in
        `cash_dividends[1].amount`.

    Examples
    --------
    >>> option, market = contract_from(
    ...     {
    ...         "option_type": "call",
    ...         "spot": 100.0,
    ...         "strike": 100.0,
    ...         "rate": 0.05,
    ...         "volatility": '{"times": [0.5, 1.0], "values": [0.2, 0.3]}',
    ...         "valuation_date": "2026-01-01",
    ...         "expiration_date": "2027-01-01",
    ...         "cash_dividends": [{"ex_date": "2026-03-15", "amount": 1.0}],
    ...     }
    ... )
    >>> option.expiry, market.cash_dividends, market.volatility.values
    (1.0, (CashDividend(time=0.2, amount=1.0),), (0.2, 0.3))
    """
    check_kind("contract", contract, Mapping, "a mapping of names to values")
    unknown = [str(name) for name in contract if name not in NAMES]
    if unknown:
        raise unknown_names("contract", unknown, NAMES)
    for name in REQUIRED:
        if name not in contract:
            raise InvalidInputError(name, "missing", "given")
    values = {name: _unpacked(v) if isinstance(v, np.ndarray) else v for name, v in contract.items()}
    given = {name: v for name, v in values.items() if name not in OPTIONAL or not is_missing(v)}
    expiry, start = _life(given, values)
    return _option(given, expiry, start), _market(given, start)


def is_missing(value: object) -> bool:
    """Tell whether an optional value is not given: None, NaN, a date that is none, or blank text.

    Examples
    --------
    >>> [is_missing(value) for value in (None, float("nan"), " ", 0.0, [], "nan")]
    [True, True, True, False, False, False]
    """
    if isinstance(value, str):
        return not value.strip(" \t")
    if isinstance(value, float | np.generic | dt.date):
        return bool(value != value)  # noqa: PLR0124  # NaN, and NumPy's and pandas' dates that are none
    return value is None


def _life(given: Mapping[str, Any], values: Mapping[str, Any]) -> tuple[Any, dt.datetime | None]:
    """Return the expiry, and the valuation date if there is one."""
    dated = [name for name in DATES if name in given]
    if not dated:
        if values.get("expiry") is None:
            raise InvalidInputError("expiry", "missing", "given, or valuation_date and expiration_date")
        return values["expiry"], None
    if "expiry" in given:
        raise InvalidInputError("expiry", given["expiry"], "left out where dates are given")
    for name in DATES:
        if name not in given:
            raise InvalidInputError(name, "missing", f"given where {dated[0]} is")
    start = read_moment("valuation_date", given["valuation_date"])
    return expiry_from_dates(given["valuation_date"], given["expiration_date"]), start


def _option(given: Mapping[str, Any], expiry: Any, start: dt.datetime | None) -> Option:
    return Option(
        given["option_type"],
        given["strike"],
        expiry,
        given.get("exercise", EXERCISE.default),
        _exercise_times(given, expiry, start),
        _exercise_start(given.get("exercise_start", EXERCISE_START.default), expiry, start),
        given.get("settlement_lag", SETTLEMENT_LAG.default),
    )


def _market(given: Mapping[str, Any], start: dt.datetime | None) -> Market:
    return Market(
        given["spot"],
        _curve("rate", given["rate"]),
        _volatility(given["volatility"]),
        _curve("dividend_yield", given.get("dividend_yield", DIVIDEND_YIELD.default)),
        _timed("cash_dividends", given, start),
        _timed("proportional_dividends", given, start),
        given.get("dividend_model", DIVIDEND_MODEL.default),
        given.get("underlying", UNDERLYING.default),
        _curve("borrow_rate", given.get("borrow_rate", BORROW_RATE.default)),
        _curve("foreign_rate", given.get("foreign_rate")),
        given.get("quanto_covariance", QUANTO_COVARIANCE.default),
    )


def _exercise_times(given: Mapping[str, Any], expiry: Any, start: dt.datetime | None) -> Any:
    """Return the exercise times with dates as years from now."""
    entries = _listed("exercise_times", given)
    if not isinstance(entries, Sequence) or isinstance(entries, str | bytes):
        return entries
    times = list(entries)
    for i, entry in enumerate(entries):
        if isinstance(entry, DATE_KINDS):
            times[i] = _years(f"exercise_times[{i}]", entry, start)
            if not 0.0 < times[i] <= expiry:
                allowed = "after valuation_date, and not after expiration_date"
                raise InvalidInputError(f"exercise_times[{i}]", str(entry), allowed)
    return tuple(times)


def _exercise_start(value: Any, expiry: Any, start: dt.datetime | None) -> Any:
    """Return the start of the exercise window, a date as years from now: 0 where the window is open already."""
    if not isinstance(value, DATE_KINDS):
        return value
    years = max(_years("exercise_start", value, start), 0.0)
    if years > expiry:
        raise InvalidInputError("exercise_start", str(value), "a date that is not after expiration_date")
    return years


def _years(field: str, date: object, start: dt.datetime | None) -> float:
    """Return the years from the valuation date to another date."""
    if start is None:
        allowed = "a number of years from now; a date where there is a valuation_date"
        raise InvalidInputError(field, date, allowed)
    return years_from(start, field, date)


def _unpacked(array: np.ndarray[Any, Any]) -> Any:
    """Return an array as lists; NumPy itself would make numbers of dates to the nanosecond."""
    return (array.astype("M8[us]") if array.dtype.kind == "M" else array).tolist()


def _curve(field: str, value: Any) -> Any:
    """Return a curve for its text; a number for what `Market` reads as one."""
    if isinstance(value, str) and value.lstrip().startswith("{"):
        return parse_cell(field, value, input_field(field).allowed)
    return value


def _volatility(value: Any) -> Any:
    """Return the same of a volatility: the text of a surface may be long, and that of many contracts."""
    return _surface(value) if isinstance(value, str) and '"spots"' in value else _curve("volatility", value)


@lru_cache(maxsize=16)
def _surface(text: str) -> Volatility:
    return read_volatility(_curve("volatility", text))


def _listed(field: str, given: Mapping[str, Any]) -> Any:
    """Return a list for its text, () where there is none; what is no list is for the constructors to refuse."""
    value = given.get(field, ())
    if isinstance(value, str):
        value = parse_cell(field, value, input_field(field).allowed)
    return value.item() if isinstance(value, np.generic) else value


def _timed(field: str, given: Mapping[str, Any], start: dt.datetime | None) -> Any:
    """Return the dividends with their ex-dates as times."""
    entries = _listed(field, given)
    if not isinstance(entries, Sequence) or isinstance(entries, str | bytes):
        return entries
    return [
        _with_time(f"{field}[{i}].ex_date", entry, start) if isinstance(entry, Mapping) else entry
        for i, entry in enumerate(entries)
    ]


def _with_time(place: str, entry: Mapping[str, Any], start: dt.datetime | None) -> dict[str, Any]:
    """Return a dividend with a time; `place` names its ex-date."""
    read = {name: value for name, value in entry.items() if value is not None}
    if "ex_date" not in read:
        return read
    ex_date = read.pop("ex_date")
    if "time" in read:
        raise InvalidInputError(place, ex_date, "left out where time is given")
    if start is None:
        raise InvalidInputError(place, ex_date, "left out, and time given, where there is no valuation_date")
    years = years_from(start, place, ex_date)
    return {"time": min(max(years, 0.0), EX_TIME.most), **read}  # before now it has gone, as at 0
