"""The errors of names: of arguments, keys and columns that are not known, and of those that are missing."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import MISSING, fields
from difflib import get_close_matches
from functools import wraps
from typing import Any, TypeVar

from pricing_core.american.contracts.fields import COLUMN_FIELDS, EXPIRATION_DATE, EXPIRY, VALUATION_DATE
from pricing_core.errors import InvalidInputError, Told

# Unknown names that are compared with the known ones, and characters of each; chosen.
MOST_COMPARED, LONGEST_COMPARED = 10, 40

Record = TypeVar("Record")


def arguments_named(record: type[Record]) -> type[Record]:
    """Let a dataclass name the arguments that are not known or missing in an `InvalidInputError`, not a `TypeError`."""
    make = record.__init__

    @wraps(make)
    def checked(self: Record, *arguments: Any, **named: Any) -> None:
        try:
            make(self, *arguments, **named)
        except TypeError:
            known = [field.name for field in fields(record)]  # type: ignore[arg-type]
            unknown = [name for name in named if name not in known]
            if unknown:
                raise unknown_names(f"argument of {record.__name__}", unknown, known) from None
            given = {*known[: len(arguments)], *named}
            for field in fields(record):  # type: ignore[arg-type]
                if field.default is MISSING and field.name not in given:
                    raise InvalidInputError(field.name, Told("missing"), "given") from None
            raise

    record.__init__ = checked  # type: ignore[assignment]
    return record


def unknown_names(field: str, unknown: Sequence[str], names: Iterable[str]) -> InvalidInputError:
    """Return the error of names that are not known: which they are, the nearest that are known, and then all of these.

    Examples
    --------
    >>> print(unknown_names("columns", ["vol"], ["spot", "volatility"]))
    columns = 'vol': must be volatility, or another of the names spot, volatility
    """
    return InvalidInputError(field, ", ".join(unknown), nearest_names(unknown, names))


def nearest_names(unknown: Sequence[str], names: Iterable[str]) -> str:
    """Return what completes "must be ..." where names are not known: the nearest that are, and then all of these.

    Examples
    --------
    >>> nearest_names(["vol", "foo"], ["spot", "volatility"])
    'volatility, or another of the names spot, volatility'
    """
    known = list(names)
    compared = [name[:LONGEST_COMPARED].lower() for name in unknown[:MOST_COMPARED]]
    nearest = dict.fromkeys(word for name in compared for word in _nearest(name, known))
    allowed = f"{', '.join(nearest)}, or another of the names" if nearest else "one of the names"
    return f"{allowed} {', '.join(known)}"


def check_complete(names: Collection[str]) -> None:
    """Accept the names of columns if all that are required are there.

    Raises
    ------
    InvalidInputError
        Some are missing; the message names each with its unit.

    Examples
    --------
    >>> check_complete(["option_type", "spot", "expiry", "volatility"])
    Traceback (most recent call last):
    ...
    pricing_core.errors.InvalidInputError: columns = 2 missing: must be completed by strike (money), rate (1/year)
    """
    dated = VALUATION_DATE.name in names and EXPIRATION_DATE.name in names
    missing = [
        column
        for column in COLUMN_FIELDS
        if column.required and column.name not in names and not (dated and column is EXPIRY)
    ]
    if missing:
        dates = {EXPIRY.name: f"; or {VALUATION_DATE.name} and {EXPIRATION_DATE.name} in its place"}
        told = (f"{column.name} ({column.in_brief}{dates.get(column.name, '')})" for column in missing)
        raise InvalidInputError("columns", Told(f"{len(missing)} missing"), f"completed by {', '.join(told)}")


def _nearest(name: str, known: Sequence[str]) -> list[str]:
    """Return the known name that is most like another one, or begins with it; none where none does."""
    begun = [word for word in known if name and word.startswith(name)]
    return (get_close_matches(name, known, n=1) + begun)[:1]
