"""Dividends that are paid at known times: amounts of money, or fractions of the spot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import LARGEST_EXPIRY, LARGEST_MONEY, real_number
from pricing_core.errors import SHOWN_CHARACTERS, InvalidInputError, Told

MOST_DIVIDENDS = 1000
LATEST = 10.0 * LARGEST_EXPIRY  # years


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
        object.__setattr__(self, "time", real_number("time", self.time, 0.0, LATEST))
        object.__setattr__(self, "amount", real_number("amount", self.amount, 0.0, LARGEST_MONEY))


@dataclass(frozen=True, slots=True)
class ProportionalDividend:
    """A fraction that the spot loses at its ex-time.

    Parameters
    ----------
    time : float
        Ex-time, years from now, >= 0; at 0 it has gone from the spot already, after expiry it is ignored.
    fraction : float
        Of the spot, 0 to 1.
    """

    time: float
    fraction: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", real_number("time", self.time, 0.0, LATEST))
        object.__setattr__(self, "fraction", real_number("fraction", self.fraction, 0.0, 1.0))


def read_cash_dividends(value: object) -> tuple[CashDividend, ...]:
    """Return the dividends in the order of time; `value` lists `CashDividend`s or mappings.

    Raises
    ------
    InvalidInputError
        Naming cash_dividends and what is wrong.
    """
    read = [
        entry
        if isinstance(entry, CashDividend)
        else CashDividend(*_fields("cash_dividends", i, entry, "amount"))
        for i, entry in enumerate(_entries("cash_dividends", value))
    ]
    return tuple(sorted(read, key=lambda dividend: dividend.time))


def read_proportional_dividends(value: object) -> tuple[ProportionalDividend, ...]:
    """Return the dividends in the order of time; `value` lists `ProportionalDividend`s or mappings.

    Raises
    ------
    InvalidInputError
        Naming proportional_dividends and what is wrong.
    """
    field = "proportional_dividends"
    read = [
        entry
        if isinstance(entry, ProportionalDividend)
        else ProportionalDividend(*_fields(field, i, entry, "fraction"))
        for i, entry in enumerate(_entries(field, value))
    ]
    return tuple(sorted(read, key=lambda dividend: dividend.time))


def _entries(field: str, value: object) -> Sequence[object] | NDArray[Any]:
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str | bytes):
        raise InvalidInputError(field, value, "a list of dividends")
    if len(value) > MOST_DIVIDENDS:
        raise InvalidInputError(field, Told(f"{len(value)} entries"), f"at most {MOST_DIVIDENDS} dividends")
    return value


def _fields(field: str, index: int, entry: object, what: str) -> tuple[float, float]:
    """Return (time, amount or fraction) of a mapping, checked, faults named by their place in the list."""
    if not isinstance(entry, Mapping):
        raise InvalidInputError(f"{field}[{index}]", entry, f'{{"time": ..., "{what}": ...}}')
    needed = {"time": "given, or ex_date where there is a valuation_date", what: "given"}
    for name, allowed in needed.items():
        if name not in entry:
            raise InvalidInputError(f"{field}[{index}].{name}", Told("missing"), allowed)
    for name, value in entry.items():
        if name not in needed:
            allowed = f"left out: a dividend has time and {what}"
            raise InvalidInputError(f"{field}[{index}].{str(name)[:SHOWN_CHARACTERS]}", value, allowed)
    most = LARGEST_MONEY if what == "amount" else 1.0
    return (
        real_number(f"{field}[{index}].time", entry["time"], 0.0, LATEST),
        real_number(f"{field}[{index}].{what}", entry[what], 0.0, most),
    )
