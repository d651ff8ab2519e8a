"""The errors of names: of arguments, keys and columns that are not known, and of those that are missing."""

from __future__ import annotations

from collections.abc import Collection
from functools import wraps
from inspect import Parameter, signature
from typing import Any, TypeVar

from pricing_core.american.contracts.fields import COLUMN_FIELDS, EXPIRATION_DATE, EXPIRY, VALUATION_DATE
from pricing_core.errors import MissingInputError, UnknownNameError

Record = TypeVar("Record")
DATES_INSTEAD = f"{VALUATION_DATE.name} and {EXPIRATION_DATE.name} in its place"


def arguments_named(record: type[Record]) -> type[Record]:
    """Let a dataclass name the arguments that are not known or missing in an `InvalidInputError`, not a `TypeError`."""
    make = record.__init__
    parameters = dict([*signature(make).parameters.items()][1:])

    @wraps(make)
    def checked(self: Record, *arguments: Any, **named: Any) -> None:
        try:
            make(self, *arguments, **named)
        except TypeError:
            unknown = [name for name in named if name not in parameters]
            if unknown:
                raise UnknownNameError("argument", unknown, [*parameters], record.__name__) from None
            given = {*[*parameters][: len(arguments)], *named}
            required = [name for name, told in parameters.items() if told.default is Parameter.empty]
            missing = {name: "" for name in required if name not in given}
            if missing:
                raise MissingInputError(missing) from None
            raise

    record.__init__ = checked  # type: ignore[assignment]
    return record


def check_complete(names: Collection[str]) -> None:
    """Accept the names of columns if all that are required are there.

    Raises
    ------
    MissingInputError
        Some are missing; the message names each with its unit.

    Examples
    --------
    >>> check_complete(["option_type", "spot", "expiry", "volatility"])
    Traceback (most recent call last):
    ...
    pricing_core.errors.MissingInputError: strike (money) and rate (1/year) are missing
    """
    dated = VALUATION_DATE.name in names and EXPIRATION_DATE.name in names
    missing = {
        column.name: column.in_brief + (f"; or {DATES_INSTEAD}" if column is EXPIRY else "")
        for column in COLUMN_FIELDS
        if column.required and column.name not in names and not (dated and column is EXPIRY)
    }
    if missing:
        raise MissingInputError(missing)
