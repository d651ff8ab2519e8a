"""Dividends that are paid at known times: amounts of money, or fractions of the spot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import (
    AMOUNT,
    CASH_DIVIDENDS,
    EX_TIME,
    FRACTION,
    PROPORTIONAL_DIVIDENDS,
)
from pricing_core.american.contracts.names import arguments_named
from pricing_core.errors import SHOWN_CHARACTERS, InvalidInputError, Told


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


def read_cash_dividends(value: object) -> tuple[CashDividend, ...]:
    """Return the dividends in the order of time; `value` lists `CashDividend`s or mappings.

    Raises
    ------
    InvalidInputError
        Naming cash_dividends and what is wrong.
    """
    return _read(CASH_DIVIDENDS, CashDividend, value)


def read_proportional_dividends(value: object) -> tuple[ProportionalDividend, ...]:
    """Return the dividends in the order of time; `value` lists `ProportionalDividend`s or mappings.

    Raises
    ------
    InvalidInputError
        Naming proportional_dividends and what is wrong.
    """
    return _read(PROPORTIONAL_DIVIDENDS, ProportionalDividend, value)


def _read(field: Field, kind: type[Dividend], value: object) -> tuple[Dividend, ...]:
    """Return the dividends of one kind in the order of time."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str | bytes):
        raise InvalidInputError(field.name, value, f"a list of {_forms(field, kind)}")
    if len(value) > field.most_entries:
        raise InvalidInputError(
            field.name, Told(f"{len(value)} entries"), f"at most {field.most_entries} dividends"
        )
    read = [
        entry if isinstance(entry, kind) else kind(*_numbers(field, kind, f"{field.name}[{i}]", entry))
        for i, entry in enumerate(value)
    ]
    return tuple(sorted(read, key=lambda dividend: dividend.time))


def _forms(field: Field, kind: type) -> str:
    """Return in words how a dividend may be given."""
    time, _, size = field.entries
    return f'{{"{time.name}": ..., "{size.name}": ...}} or {kind.__name__}({time.name}, {size.name})'


def _numbers(field: Field, kind: type, place: str, entry: object) -> tuple[float, float]:
    """Return (time, amount or fraction) of a mapping, checked; `place` names it in the list."""
    time, _, size = field.entries
    if not isinstance(entry, Mapping):
        raise InvalidInputError(place, entry, _forms(field, kind))
    needed = {time.name: "given, or ex_date where there is a valuation_date", size.name: "given"}
    for name, value in entry.items():
        if name not in needed:
            allowed = f"left out: a dividend has time and {size.name}"
            raise InvalidInputError(f"{place}.{str(name)[:SHOWN_CHARACTERS]}", value, allowed)
    for name, allowed in needed.items():
        if name not in entry:
            raise InvalidInputError(f"{place}.{name}", Told("missing"), allowed)
    return time.check(entry[time.name], f"{place}.time"), size.check(entry[size.name], f"{place}.{size.name}")
