"""What is wrong with single quotes: a flag by row for each reason, and nothing is dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.chains.occ_symbol import SYMBOL
from pricing_core.chains.quotes import Quotes, as_date

Flags: TypeAlias = Mapping[str, BoolVector]

# What each flag says; quotes with one of them take no part in the fits, but for those of `TOLD`.
FLAGS = {
    "unreadable": "the row cannot be read, or a number in it is out of range: `message` says which",
    "duplicate": "another row quotes the same option, with a bid and an ask that are nearer or came first",
    "expired": "the last trading moment has passed",
    "stale": "quoted on an earlier day than the valuation, or with another price of the underlying",
    "adjusted": "another multiplier than most, or a symbol of an adjusted deliverable",
    "zero": "neither a bid nor an ask",
    "one_sided": "a bid without an ask, or an ask without a bid",
    "crossed": "the bid is above the ask",
    "locked": "the bid is the ask",
    "below_intrinsic": "the mid is below what exercise brings by more than the spread",
    "no_carry": "no pair of call and put tells the carry of any expiration: the given dividends alone are used",
    "put_call_mismatch": "the volatilities of call and put of the strike differ by more than their spreads",
}
TOLD = ("locked", "no_carry", "put_call_mismatch")
LARGEST_SPOT_GAP = 0.005  # of the underlying's price in one row to that of the chain, relative; chosen


def flag_quotes(quotes: Quotes) -> dict[str, BoolVector]:
    """Return the flags that single rows show, each of shape (n,)."""
    bid, ask = quotes.bid, quotes.ask
    with np.errstate(invalid="ignore"):
        negative = (bid < 0.0) | (ask < 0.0)
        has_bid, has_ask = bid > 0.0, ask > 0.0
        crossed = has_bid & has_ask & (bid > ask)
        gap = quotes.intrinsic - 0.5 * (bid + ask)
        below = has_bid & has_ask & ~crossed & (gap > ask - bid)
        flags = {
            "unreadable": ~quotes.readable | negative,
            "duplicate": np.zeros(bid.size, dtype=bool),
            "expired": quotes.expiry <= 0.0,
            "stale": _stale(quotes),
            "adjusted": _adjusted(quotes),
            "zero": ~has_bid & ~has_ask,
            "one_sided": has_bid != has_ask,
            "crossed": crossed,
            "locked": has_bid & (bid == ask),
            "below_intrinsic": below & (quotes.exercise == "american"),
        }
    unread = flags["unreadable"]
    flags = {name: column & (~unread | (name == "unreadable")) for name, column in flags.items()}
    flags["duplicate"] = _duplicates(quotes, flags)
    return flags


def usable(flags: Flags) -> BoolVector:
    """Return which rows may take part in the fits, shape (n,)."""
    out = [column for name, column in flags.items() if name not in TOLD]
    good: BoolVector = ~np.any(out, axis=0)
    return good


def counts(flags: Flags) -> dict[str, int]:
    """Return how many rows have each flag, those that none has left out."""
    return {name: int(column.sum()) for name, column in flags.items() if column.any()}


def as_words(flags: Flags) -> list[str]:
    """Return the flags of every row in words, with commas between them."""
    count = next(iter(flags.values())).size
    words: list[list[str]] = [[] for _ in range(count)]
    for name, column in flags.items():
        for row in np.flatnonzero(column).tolist():
            words[row].append(name)
    return [",".join(found) for found in words]


def _stale(quotes: Quotes) -> BoolVector:
    today = as_date(quotes.valuation)
    late = [date is not None and as_date(date) < today for date in quotes.column("quote_date")]
    price = np.array(quotes.table["underlying_price"].to_numpy(zero_copy_only=False), dtype=np.float64)
    with np.errstate(invalid="ignore"):
        other = np.abs(price / quotes.spot - 1.0) > LARGEST_SPOT_GAP
    stale: BoolVector = np.array(late, dtype=bool) | other
    return stale


def _adjusted(quotes: Quotes) -> BoolVector:
    multipliers = quotes.column("contract_multiplier")
    counted = Counter(value for value in multipliers if value is not None)
    usual = counted.most_common(1)[0][0] if counted else None
    other = [value not in (None, usual) for value in multipliers]
    symbols = [_is_adjusted(symbol) for symbol in quotes.column("contract_symbol")]
    adjusted: BoolVector = np.array(other, dtype=bool) | np.array(symbols, dtype=bool)
    return adjusted


def _is_adjusted(symbol: str | None) -> bool:
    found = None if symbol is None else SYMBOL.fullmatch(symbol)
    return found is not None and found.group(1)[-1].isdigit()


def _duplicates(quotes: Quotes, flags: Flags) -> BoolVector:
    """Return the rows whose option another row quotes better: without other flags first, then nearer, then earlier."""
    worse = np.any([flags[name] for name in flags if name not in (*TOLD, "duplicate")], axis=0)
    width = np.nan_to_num(quotes.ask - quotes.bid, nan=np.inf)
    order = np.lexsort((np.arange(width.size), width, worse)).tolist()
    seen: set[tuple[object, ...]] = set()
    found = np.zeros(width.size, dtype=bool)
    roots = [_root(symbol) for symbol in quotes.column("contract_symbol")]
    for row in order:
        if flags["unreadable"][row]:
            continue
        key = (roots[row], quotes.expiry.item(row), quotes.strike.item(row), bool(quotes.is_call[row]))
        found[row] = key in seen
        seen.add(key)
    return found


def _root(symbol: str | None) -> str | None:
    found = None if symbol is None else SYMBOL.fullmatch(symbol)
    return found.group(1) if found else symbol
