"""Every accepted spelling of every field of a contract, and the table of the documentation that lists them.

`python -m tests.doors.spellings > docs/spellings.md` writes the table anew.
"""

import datetime as dt
import math
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd

from pricing_core.american import CashDividend, LocalVolatility, PiecewiseConstant, ProportionalDividend
from pricing_core.american.contracts.fields import CONTRACT_FIELDS
from tests.doors.doors import DOORS

Contract = dict[str, Any]

PLAIN: Contract = {
    "option_type": "put",
    "spot": 95.0,
    "strike": 100.0,
    "expiry": 1.0,
    "rate": 0.05,
    "volatility": 0.25,
}
DATED: Contract = {
    **{name: value for name, value in PLAIN.items() if name != "expiry"},
    "valuation_date": "2026-01-01",
    "expiration_date": "2027-01-01",
}
CASH = [{"time": 0.2, "amount": 1.5}, {"time": 0.6, "amount": 1.0}]
SHARES = [{"time": 0.2, "fraction": 0.02}]
CURVE = {"times": [0.5, 1.0], "values": [0.02, 0.06]}
SURFACE = {
    "times": [0.0, 1.0],
    "spots": [80.0, 100.0, 120.0],
    "values": [[0.3, 0.25, 0.2], [0.28, 0.24, 0.2]],
}


@dataclass(frozen=True)
class Spelling:
    """One way to write some fields of a contract.

    Parameters
    ----------
    field : str
        The field that it shows.
    words : str
        What it is, for the table.
    written : mapping of str to object
        The contract with it, in Python's values.
    meant : mapping of str to object
        The same contract in plain numbers and words.
    """

    field: str
    words: str
    written: Contract
    meant: Contract


def _of(
    field: str, words: str, value: object, meant: object, base: Contract = PLAIN, **others: Any
) -> Spelling:
    return Spelling(field, words, {**base, **others, field: value}, {**base, **others, field: meant})


def _dated(words: str, field: str, value: object, meant: Contract, **others: Any) -> Spelling:
    undated = {name: other for name, other in others.items() if name != "expiration_date"}
    return Spelling(field, words, {**DATED, **others, field: value}, {**PLAIN, **undated, **meant})


def _numbers() -> list[Spelling]:
    whole: Contract = {"spot": 95, "strike": 100, "expiry": 1, "rate": 0, "settlement_lag": 2}
    found = [_of(field, "an int", value, float(value)) for field, value in whole.items()]
    for field, number in (
        ("spot", 95.0),
        ("strike", 100.0),
        ("expiry", 0.5),
        ("rate", 0.0625),
        ("volatility", 0.25),
    ):
        found += [
            _of(field, "a number of NumPy", np.float32(number), number),
            _of(field, "a Decimal", Decimal(str(number)), number),
            _of(field, "a Fraction", Fraction(number), number),
        ]
    return found


def _words() -> list[Spelling]:
    bermudan: Contract = {"exercise_times": [0.5]}
    future: Contract = {**PLAIN, "spot": 97.0}
    return [
        *(_of("option_type", f"`{word}`", word, "put") for word in ("Put", "PUT", " put ", "p", "P", "puts")),
        *(_of("option_type", f"`{word}`", word, "call") for word in ("Call", "c", "C", "calls")),
        *(_of("exercise", f"`{word}`", word, "american") for word in ("American", "A")),
        *(_of("exercise", f"`{word}`", word, "european") for word in ("European", "EUROPEAN", "e")),
        _of("exercise", "`Bermudan`", "Bermudan", "bermudan", **bermudan),
        *(_of("underlying", f"`{word}`", word, "future", future) for word in ("Future", "FUTURE")),
        _of("underlying", "`Spot`", "Spot", "spot"),
        _of("dividend_model", "`Escrowed`", "Escrowed", "escrowed", cash_dividends=CASH),
        _of("dividend_model", "`SPOT`", "SPOT", "spot", cash_dividends=CASH),
    ]


def _dates() -> list[Spelling]:
    half = {"expiry": 1.0}
    found = []
    for words, date in (
        ("an ISO date", "2027-01-01"),
        ("an ISO date-time", "2027-01-01T00:00"),
        ("a date", dt.date(2027, 1, 1)),
        ("a date-time", dt.datetime(2027, 1, 1)),
        ("a Timestamp of pandas", pd.Timestamp("2027-01-01")),
        ("a datetime64 of NumPy", np.datetime64("2027-01-01")),
    ):
        found.append(_dated(words, "expiration_date", date, half))
    zoned = {"expiration_date": "2027-01-01T00:00Z"}
    found.append(
        _dated(
            "a date-time with its offset from UTC", "valuation_date", "2026-01-01T01:00+01:00", half, **zoned
        )
    )
    found.append(_dated("a Timestamp of pandas", "valuation_date", pd.Timestamp("2026-01-01"), half))
    return found


def _dividends() -> list[Spelling]:
    pairs = [(entry["time"], entry["amount"]) for entry in CASH]
    by_date = [{"ex_date": "2026-03-15", "amount": 1.5}]
    at_date = {"cash_dividends": [{"time": 0.2, "amount": 1.5}]}
    share = [(0.2, 0.02)]
    by_share_date = [("2026-03-15", 0.02)]
    return [
        _of("cash_dividends", "`{time, amount}` in any order", CASH[::-1], CASH),
        _of("cash_dividends", "pairs `(time, amount)`", pairs, CASH),
        _of("cash_dividends", "pairs as lists", [list(pair) for pair in pairs], CASH),
        _of("cash_dividends", "an array of pairs", np.array(pairs), CASH),
        _of("cash_dividends", "`CashDividend`", [CashDividend(*pair) for pair in pairs], CASH),
        _of("cash_dividends", "Decimals", [(Decimal("0.2"), Decimal("1.5"))], CASH[:1]),
        _of(
            "cash_dividends",
            "numbers of NumPy",
            [{"time": np.float64(0.2), "amount": np.float32(1.5)}],
            CASH[:1],
        ),
        _of("cash_dividends", "JSON text", '[{"time": 0.2, "amount": 1.5}]', CASH[:1]),
        _of("cash_dividends", "JSON text of pairs", "[[0.2, 1.5]]", CASH[:1]),
        _dated("`{ex_date, amount}`", "cash_dividends", by_date, at_date),
        _dated("pairs `(date, amount)`", "cash_dividends", [("2026-03-15", 1.5)], at_date),
        _dated("pairs with a date", "cash_dividends", [(dt.date(2026, 3, 15), 1.5)], at_date),
        _of("proportional_dividends", "pairs `(time, fraction)`", share, SHARES),
        _of("proportional_dividends", "`ProportionalDividend`", [ProportionalDividend(0.2, 0.02)], SHARES),
        _dated(
            "pairs `(date, fraction)`",
            "proportional_dividends",
            by_share_date,
            {"proportional_dividends": SHARES},
        ),
    ]


def _times() -> list[Spelling]:
    bermudan: Contract = {**PLAIN, "exercise": "bermudan"}
    dated = {"exercise_times": [0.2, 1.0]}
    return [
        _of("exercise_times", "a tuple in any order", (0.75, 0.25), [0.25, 0.75], bermudan),
        _of("exercise_times", "an array", np.array([0.25, 0.75]), [0.25, 0.75], bermudan),
        _of("exercise_times", "JSON text", "[0.25, 0.75]", [0.25, 0.75], bermudan),
        _dated("ISO dates", "exercise_times", ["2026-03-15", "2027-01-01"], dated, exercise="bermudan"),
        _dated(
            "dates", "exercise_times", [dt.date(2026, 3, 15), dt.date(2027, 1, 1)], dated, exercise="bermudan"
        ),
        _of("exercise_start", "an int", 0, 0.0),
        _dated("an ISO date", "exercise_start", "2026-03-15", {"exercise_start": 0.2}),
        _dated("a date", "exercise_start", dt.date(2026, 3, 15), {"exercise_start": 0.2}),
    ]


def _curves() -> list[Spelling]:
    as_object = PiecewiseConstant(CURVE["times"], CURVE["values"])
    found = []
    for field in ("rate", "dividend_yield", "borrow_rate"):
        found += [
            _of(field, "`PiecewiseConstant`", as_object, CURVE),
            _of(field, "JSON text", '{"times": [0.5, 1], "values": [0.02, 0.06]}', CURVE),
        ]
    text = str(SURFACE).replace("'", '"')
    return [
        *found,
        _of("rate", "tuples", {"times": (0.5, 1), "values": (0.02, Decimal("0.06"))}, CURVE),
        _of("foreign_rate", "JSON text", '{"times": [0.5, 1], "values": [0.02, 0.06]}', CURVE),
        _of("quanto_covariance", "a Decimal", Decimal("0.01"), 0.01, foreign_rate=0.03),
        _of("volatility", "`LocalVolatility`", LocalVolatility(**SURFACE), SURFACE),
        _of("volatility", "JSON text of a surface", text, SURFACE),
    ]


def _nothing() -> list[Spelling]:
    """Return what stands for a value that is not given, where a table has a cell for it all the same."""
    empty = ("cash_dividends", "exercise_times", "borrow_rate", "foreign_rate", "valuation_date")
    return [Spelling(name, "nothing, in a table", {**PLAIN, name: None}, PLAIN) for name in empty]


SPELLINGS = (*_words(), *_numbers(), *_dates(), *_dividends(), *_times(), *_curves())
EMPTY = tuple(_nothing())
# What no door takes: values that a slip of the pen makes.
REFUSED: tuple[tuple[str, str, Contract], ...] = (
    ("option_type", "another word", {**PLAIN, "option_type": "straddel"}),
    ("spot", "a truth value", {**PLAIN, "spot": True}),
    ("strike", "a list", {**PLAIN, "strike": [100.0, 101.0]}),
    ("strike", "NaN", {**PLAIN, "strike": math.nan}),
    ("volatility", "a negative number", {**PLAIN, "volatility": -0.2}),
    ("rate", "per cent", {**PLAIN, "rate": "5%"}),
    ("expiration_date", "day before month", {**DATED, "expiration_date": "01.01.2027"}),
    ("cash_dividends", "three numbers", {**PLAIN, "cash_dividends": [(0.2, 1.5, 1.0)]}),
    (
        "cash_dividends",
        "a date without a `valuation_date`",
        {**PLAIN, "cash_dividends": [("2026-03-15", 1.5)]},
    ),
    ("exercise_times", "a time after the expiry", {**PLAIN, "exercise": "bermudan", "exercise_times": [1.5]}),
)


def page() -> str:
    """Return the page of the documentation."""
    doors = "\n".join(f"* {name}: {door.words}" for name, door in DOORS.items())
    rows = []
    for field in CONTRACT_FIELDS:
        taken = dict.fromkeys(one.words for one in SPELLINGS if one.field == field.name)
        if taken:
            refused = ", ".join(words for name, words, _ in REFUSED if name == field.name)
            rows.append(f"| `{field.name}` | {', '.join(taken)} | {refused} |")
    table = "\n".join(["| field | also written as | taken by no door |", "|---|---|---|", *rows])
    return HEAD.format(doors=doors, table=table, count=len(SPELLINGS) * len(DOORS))


HEAD = """# Spellings

What one door of the library takes, all take. A test walks through every door with every spelling in this table ({count}
calls) and compares the price with that of the plain contract; it also compares this page with what it has tried.

The doors are:

{doors}

Each door takes a value as it can hold it: a file and a command line hold text, JSON has no dates, a frame has columns.
Where text is all that a door has, the text of a number is a number; in Python, in columns of numbers and in JSON it is
refused. In a table a cell that holds nothing (null, NaN, blank) stands for an optional value that is not given.

{table}

Words are understood in any case and with blanks around them. Names of fields are written as they stand here; for
another name the error says which is nearest.
"""


if __name__ == "__main__":
    print(page(), end="")
