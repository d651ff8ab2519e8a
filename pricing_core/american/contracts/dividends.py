"""Dividends that are paid at known times: amounts of money, or fractions of the spot."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard, TypeVar

import numpy as np

from pricing_core.american.contracts.dates import AnyDate, is_date, years_from_now
from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import (
    AMOUNT,
    CASH_DIVIDENDS,
    EX_DATE,
    EX_TIME,
    FRACTION,
    PROPORTIONAL_DIVIDENDS,
)
from pricing_core.american.contracts.json_text import from_text
from pricing_core.american.contracts.names import arguments_named
from pricing_core.errors import InvalidInputError, MissingInputError, Told, UnknownNameError


@arguments_named
@dataclass(frozen=True, slots=True)
class CashDividend:
    """An amount that the spot drops by at its ex-time; where it exceeds the spot, the spot drops to zero.

    Parameters
    ----------
    time : float
        Ex-time, years from now, >= 0; at 0 it has gone from the spot already, after expiry it is ignored.
    amount : float
        Money per unit of underlying, >= 0.
    """

    time: float
    amount: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", EX_TIME.check(self.time))
        object.__setattr__(self, "amount", AMOUNT.check(self.amount))


@arguments_named
@dataclass(frozen=True, slots=True)
class ProportionalDividend:
    """A fraction that the spot loses at its ex-time.

    Parameters
    ----------
    time : float
        Ex-time, years from now, >= 0; at 0 it has gone from the spot already, after expiry it is ignored.
    fraction : float
        Fraction of the spot, 0 to 1.
    """

    time: float
    fraction: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", EX_TIME.check(self.time))
        object.__setattr__(self, "fraction", FRACTION.check(self.fraction))


Dividend = TypeVar("Dividend", CashDividend, ProportionalDividend)
# What a list of dividends may hold, and the two parts of a pair may not.
ENTRIES = (Mapping, list, tuple, np.ndarray, CashDividend, ProportionalDividend)


def read_cash_dividends(value: object, now: dt.datetime | None = None) -> tuple[CashDividend, ...]:
    """Return the dividends in the order of time.

    Parameters
    ----------
    value : list of CashDividend, pairs or mappings, or its JSON
        A pair holds the ex-time, or the ex-date, and the amount; a mapping `time` or `ex_date`, and `amount`.
    now : datetime.datetime, optional
        The valuation date, as `moment_of_valuation` returns it: where there is one, ex-dates may be given, and a
        dividend before it is one at time 0.

    Raises
    ------
    InvalidInputError
        Naming cash_dividends and what is wrong.
    """
    return _read(CASH_DIVIDENDS, CashDividend, value, now)


def read_proportional_dividends(
    value: object, now: dt.datetime | None = None
) -> tuple[ProportionalDividend, ...]:
    """Return the dividends in the order of time, as `read_cash_dividends` does, with fractions for amounts.

    Raises
    ------
    InvalidInputError
        Naming proportional_dividends and what is wrong.
    """
    return _read(PROPORTIONAL_DIVIDENDS, ProportionalDividend, value, now)


def is_pair(entry: object) -> TypeGuard[Sequence[object]]:
    """Tell a dividend that is given as its time and its size from a list of dividends."""
    if not isinstance(entry, list | tuple | np.ndarray) or len(entry) != 2:
        return False
    return not any(isinstance(part, ENTRIES) for part in entry)


def _read(field: Field, kind: type[Dividend], value: object, now: dt.datetime | None) -> tuple[Dividend, ...]:
    """Return the dividends of one kind in the order of time."""
    entries = from_text(field, value)
    if not isinstance(entries, Sequence | np.ndarray) or isinstance(entries, bytes):
        raise InvalidInputError(field.name, value, f"a list of {_forms(field, kind)}")
    if len(entries) > field.most_entries:
        raise InvalidInputError(
            field.name, Told(f"{len(entries)} entries"), f"at most {field.most_entries} dividends"
        )
    read = [
        entry if isinstance(entry, kind) else kind(*_numbers(field, kind, f"{field.name}[{i}]", entry, now))
        for i, entry in enumerate(entries)
    ]
    return tuple(sorted(read, key=lambda dividend: dividend.time))


def _forms(field: Field, kind: type) -> str:
    """Return in words how a dividend may be given."""
    time, _, size = field.entries
    forms = f'{{"{time.name}": ..., "{size.name}": ...}}, ({time.name}, {size.name})'
    return f"{forms} or {kind.__name__}({time.name}, {size.name})"


def _numbers(
    field: Field, kind: type, place: str, entry: object, now: dt.datetime | None
) -> tuple[float, float]:
    """Return (time, amount or fraction) of a mapping or a pair, checked; `place` names it in the list."""
    time, _, size = field.entries
    if is_pair(entry):
        when, what = entry
        return _time(place, when, now), size.check(what, f"{place}.{size.name}")
    if not isinstance(entry, Mapping):
        raise InvalidInputError(place, entry, _forms(field, kind))
    given = {name: value for name, value in entry.items() if value is not None}
    known = [entry_field.name for entry_field in field.entries]
    unknown = [str(name) for name in given if name not in known]
    if unknown:
        raise UnknownNameError("key", unknown, known, place)
    if size.name not in given:
        raise MissingInputError(f"{place}.{size.name}")
    if EX_DATE.name not in given:
        if time.name not in given:
            raise MissingInputError(
                f"{place}.{time.name}", "give it, or ex_date where there is a valuation_date"
            )
        years = time.check(given[time.name], f"{place}.{time.name}")
    else:
        if time.name in given:
            raise InvalidInputError(
                f"{place}.{EX_DATE.name}", given[EX_DATE.name], "left out where time is given"
            )
        years = _ex_time(f"{place}.{EX_DATE.name}", given[EX_DATE.name], now)
    return years, size.check(given[size.name], f"{place}.{size.name}")


def _time(place: str, when: object, now: dt.datetime | None) -> float:
    """Return the ex-time of a pair, which may be a date."""
    return _ex_time(place, when, now) if is_date(when) else EX_TIME.check(when, f"{place}.time")


def _ex_time(place: str, ex_date: AnyDate, now: dt.datetime | None) -> float:
    """Return the time of an ex-date; what lies before now has gone, as at 0."""
    return min(max(years_from_now(now, place, ex_date), 0.0), EX_TIME.most)
