"""The columns of a table of contracts: what must be there, of what type, and which names are taken."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

import pyarrow as pa

from pricing_core.american.contracts.vocabulary import DATES
from pricing_core.american.price_table import NUMBERS, SENSITIVITIES
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Column:
    """One input column.

    Parameters
    ----------
    name : str
        In the vocabulary of the public interface.
    kind : {"number", "text", "curve", "list", "date", "time"}
        A curve is a number too, a time is a number or a date; curves and lists may be JSON text.
    meaning : str
        Unit or choice, for the message that asks for the column.
    required : bool
        Whether a table without it is refused.
    """

    name: str
    kind: Literal["number", "text", "curve", "list", "date", "time"]
    meaning: str
    required: bool = True


COLUMNS = (
    Column("option_type", "text", "put or call"),
    Column("spot", "number", "money"),
    Column("strike", "number", "money"),
    Column("expiry", "number", "years"),
    Column("rate", "curve", "1/year"),
    Column("volatility", "curve", "1/sqrt(year)"),
    Column("exercise", "text", "american, european or bermudan", required=False),
    Column("exercise_times", "list", "years or dates", required=False),
    Column("exercise_start", "time", "years or a date", required=False),
    Column("dividend_yield", "curve", "1/year", required=False),
    Column("cash_dividends", "list", "years and money", required=False),
    Column("proportional_dividends", "list", "years and fractions of the spot", required=False),
    Column("dividend_model", "text", "spot or escrowed", required=False),
    Column("valuation_date", "date", "ISO date or date-time", required=False),
    Column("expiration_date", "date", "ISO date or date-time", required=False),
    Column("tolerance", "number", "fraction of the strike", required=False),
)
NUMBER_COLUMNS = tuple(column.name for column in COLUMNS if column.kind == "number")
TIME_COLUMNS = tuple(column.name for column in COLUMNS if column.kind == "time")
CURVE_COLUMNS = tuple(column.name for column in COLUMNS if column.kind == "curve")


def _letters(name: str) -> str:
    """Return what is left of a name without case, blanks, hyphens and underscores."""
    return re.sub(r"[\W_]+", "", name).casefold()


NEAR_MISS = 0.9  # similarity of two names that are taken for one

# A column under another spelling would pass through and its numbers be ignored.
_SPELLINGS = {_letters(column.name): column.name for column in COLUMNS}


def _near_miss(name: str, names: Sequence[str]) -> str | None:
    """Return the vocabulary's word that `name` is most likely meant to be, if the table does not have it."""
    absent = [word for word in _SPELLINGS.values() if word not in names]
    return next(iter(get_close_matches(name, absent, n=1, cutoff=NEAR_MISS)), None)


RESULT_NUMBERS = NUMBERS
RESULT_FLAG = "exercise_now"
RESULT_TEXTS = ("status", "method", "engine_version")
RESULT_SCHEMA = pa.schema(
    [(name, pa.float64()) for name in RESULT_NUMBERS]
    + [(RESULT_FLAG, pa.bool_())]
    + [(name, pa.string()) for name in RESULT_TEXTS]
)


def result_schema(names: Sequence[str]) -> pa.Schema:
    """Return the columns of the results for an input of these columns."""
    if "cash_dividends" not in names:
        return RESULT_SCHEMA
    return RESULT_SCHEMA.append(pa.field(SENSITIVITIES, pa.string()))  # JSON, a list per row


def check_names(names: Sequence[str]) -> None:
    """Accept the column names of a table, or say in one sentence what is wrong with them.

    Raises
    ------
    InvalidInputError
        A name appears twice or is that of another column in another spelling, a required column is missing,
        or a name is that of a result.

    Examples
    --------
    >>> check_names(["option_type", "spot", "strike", "expiry", "rate"])
    Traceback (most recent call last):
    ...
    pricing_core.errors.InvalidInputError: column volatility = 'missing': must be present (1/sqrt(year))
    """
    for name, count in Counter(names).items():
        if count > 1:
            raise InvalidInputError(f"column {name}", f"{count} columns of this name", "one column")
    for name in names:
        right = _SPELLINGS.get(_letters(name)) or _near_miss(name, names)
        if right is not None and name != right:
            raise InvalidInputError(f'column "{name}"', "another spelling", f"renamed {right}")
    dated = all(date in names for date in DATES)
    missing = [
        column
        for column in COLUMNS
        if column.required and column.name not in names and not (dated and column.name == "expiry")
    ]
    if missing:
        wanted = "; ".join(f"column {c.name} must be present ({c.meaning})" for c in missing[1:])
        allowed = f"present ({missing[0].meaning})" + (f"; {wanted}" if wanted else "")
        raise InvalidInputError(f"column {missing[0].name}", "missing", allowed)
    for name in names:
        if name in result_schema(names).names:
            raise InvalidInputError(
                f"column {name}", "an input column", "renamed: it is the name of a result"
            )


def unread_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table that pass through without being read.

    Examples
    --------
    >>> unread_columns(["id", "spot", "dividends"])
    ('id', 'dividends')
    """
    read = {column.name for column in COLUMNS}
    return tuple(name for name in names if name not in read)


def check_types(schema: pa.Schema) -> None:
    """Accept the column types of a Parquet table; an all-null column counts as empty cells.

    Raises
    ------
    InvalidInputError
        A column of the vocabulary has a type that cannot hold its values.
    """
    for column in COLUMNS:
        if column.name not in schema.names:
            continue
        found = schema.field(column.name).type
        tests, allowed = TYPES[column.kind]
        if not (pa.types.is_null(found) or any(test(found) for test in tests)):
            raise InvalidInputError(f"column {column.name}", str(found), f"a column of {allowed}")


def _is_number(found: pa.DataType) -> bool:
    return bool(pa.types.is_integer(found) or pa.types.is_floating(found) or pa.types.is_decimal(found))


def _is_text(found: pa.DataType) -> bool:
    if pa.types.is_dictionary(found):
        found = found.value_type
    return bool(
        pa.types.is_string(found) or pa.types.is_large_string(found) or pa.types.is_string_view(found)
    )


def _is_list(found: pa.DataType) -> bool:
    return bool(
        pa.types.is_list(found) or pa.types.is_large_list(found) or pa.types.is_fixed_size_list(found)
    )


# By the kind of a column: what its type may be, any of them, and that in words.
TYPES: Mapping[str, tuple[Sequence[Callable[[pa.DataType], bool]], str]] = {
    "number": ((_is_number,), "numbers (double)"),
    "text": ((_is_text,), "text (string)"),
    "curve": (
        (_is_number, _is_text, pa.types.is_struct),
        "numbers (double), or of text or structures for curves",
    ),
    "time": (
        (_is_number, _is_text, pa.types.is_date, pa.types.is_timestamp),
        "numbers (double), or of dates, timestamps or text (string)",
    ),
    "list": ((_is_text, _is_list), "lists, or of text (string)"),
    "date": ((_is_text, pa.types.is_date, pa.types.is_timestamp), "dates, timestamps or text (string)"),
}
