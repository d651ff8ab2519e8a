"""The columns of a table of contracts: what must be there, of what type, and which names are taken."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches

import pyarrow as pa

from pricing_core.american.arrow.arrow_column import is_list, is_number, is_text
from pricing_core.american.contracts.fields import COLUMN_FIELDS, Greeks
from pricing_core.american.contracts.names import check_complete
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.errors import InvalidInputError, Told, UnknownNameError

# By the kind of an output: the type of its column.
ARROW_TYPES = {
    "number": pa.float64(),
    "flag": pa.bool_(),
    "text": pa.string(),
    "list": pa.list_(pa.float64()),
}


def _letters(name: str) -> str:
    """Return what is left of a name without case, blanks, hyphens and underscores."""
    return re.sub(r"[\W_]+", "", name).casefold()


NEAR_MISS = 0.9  # Smallest similarity of two names that are taken for one.

# A column under another spelling would pass through and its numbers be ignored.
_SPELLINGS = {_letters(column.name): column.name for column in COLUMN_FIELDS}


def _near_miss(name: str, names: Sequence[str]) -> str | None:
    """Return the vocabulary's word that `name` is most likely meant to be, if the table does not have it."""
    absent = [word for word in _SPELLINGS.values() if word not in names]
    return next(iter(get_close_matches(name, absent, n=1, cutoff=NEAR_MISS)), None)


def result_schema(
    names: Sequence[str],
    greeks: Greeks = "standard",
    *,
    greek_errors: bool = False,
    advice: bool = False,
) -> pa.Schema:
    """Return the columns of the results for an input of these columns.

    Examples
    --------
    >>> standard = result_schema(["cash_dividends"]).names
    >>> [name for name in standard if name not in result_schema(["spot"], "none").names][-2:]
    ['delta_sticky_moneyness', 'dividend_sensitivities']
    """
    fields = price_fields(greeks, names, greek_errors=greek_errors, advice=advice)
    return pa.schema([(field.name, ARROW_TYPES[field.kind]) for field in fields])


def check_names(names: Sequence[str], unneeded: Sequence[str] = ()) -> None:
    """Accept the column names of a table, or say in one sentence what is wrong with them.

    Parameters
    ----------
    unneeded : sequence of str
        Columns that may be missing although they are required of a table to be priced.

    Raises
    ------
    InvalidInputError
        A name appears twice or is that of another column in another spelling, or a required column is missing.

    Examples
    --------
    >>> check_names(["option_type", "spot", "strike", "expiry", "rate"])
    Traceback (most recent call last):
    ...
    pricing_core.errors.MissingInputError: volatility (1/sqrt(year)) is missing
    """
    for name, count in Counter(names).items():
        if count > 1:
            raise InvalidInputError(f"column {name}", f"{count} columns of this name", "one column")
    for name in names:
        right = _SPELLINGS.get(_letters(name)) or _near_miss(name, names)
        if right is not None and name != right:
            raise UnknownNameError("column", [name], [right])
    check_complete({*names, *unneeded})


def check_results(names: Sequence[str], results: Sequence[str]) -> None:
    """Accept the column names of a table beside those of its results.

    Raises
    ------
    InvalidInputError
        A name is that of a result.
    """
    for name in names:
        if name in results:
            sentence = f"column {name} has the name of a result: rename it, or leave it out"
            raise InvalidInputError(f"column {name}", Told("an input column"), "renamed", sentence)


def unread_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table that pass through without being read.

    Examples
    --------
    >>> unread_columns(["id", "spot", "dividends"])
    ('id', 'dividends')
    """
    read = [column.name for column in COLUMN_FIELDS]
    return tuple(name for name in names if name not in read)


def check_types(schema: pa.Schema) -> None:
    """Accept the column types of a Parquet table; an all-null column counts as empty cells.

    Raises
    ------
    InvalidInputError
        A column of the vocabulary has a type that cannot hold its values.
    """
    for column in COLUMN_FIELDS:
        if column.name not in schema.names:
            continue
        found = schema.field(column.name).type
        tests, allowed = TYPES[column.kind]
        if not (pa.types.is_null(found) or any(test(found) for test in tests)):
            raise InvalidInputError(f"column {column.name}", str(found), f"a column of {allowed}")


# By the kind of a column: what its type may be, any of them, and that in words.
TYPES: Mapping[str, tuple[Sequence[Callable[[pa.DataType], bool]], str]] = {
    "number": ((is_number,), "numbers (double)"),
    "choice": ((is_text,), "text (string)"),
    "curve": (
        (is_number, is_text, pa.types.is_struct),
        "numbers (double), or of text or structures for curves",
    ),
    "time": (
        (is_number, is_text, pa.types.is_date, pa.types.is_timestamp),
        "numbers (double), or of dates, timestamps or text (string)",
    ),
    "list": ((is_text, is_list), "lists, or of text (string)"),
    "date": ((is_text, pa.types.is_date, pa.types.is_timestamp), "dates, timestamps or text (string)"),
}
