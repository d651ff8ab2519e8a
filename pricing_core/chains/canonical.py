"""The canonical columns of a chain of quotes, and what each of them holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pyarrow as pa

# Kind of each column; dates become timestamps where one of them has a time of day.
COLUMNS: Mapping[str, str] = {
    "underlying_symbol": "text",
    "underlying_price": "number",
    "contract_symbol": "text",
    "quote_date": "moment",
    "expiration": "date",
    "strike": "number",
    "option_type": "option_type",
    "exercise": "exercise",
    "contract_multiplier": "number",
    "bid": "number",
    "ask": "number",
    "bid_size": "number",
    "ask_size": "number",
    "last_price": "number",
    "volume": "number",
    "open_interest": "number",
    "currency": "text",
}
NEEDED = ("underlying_price", "quote_date", "expiration", "strike", "option_type", "bid", "ask")
MESSAGE = "message"  # why a row could not be read; null where it could


@dataclass(frozen=True, slots=True)
class RawTable:
    """The columns of a file under its own names.

    Parameters
    ----------
    columns : dict of str to list, each of length n
        Cells as text, or as what they were in Parquet, JSON or a frame; None where there is none.
    count : int
        Number of rows, n.
    faults : dict of int to str
        Rows that are no rows of this table, with the reason.
    """

    columns: dict[str, list[object]]
    count: int
    faults: dict[int, str] = field(default_factory=dict)


def arrow_type(kind: str, *, with_time: bool) -> pa.DataType:
    """Return the type of the canonical column of a kind."""
    if kind == "number":
        return pa.float64()
    if kind == "moment" and with_time:
        return pa.timestamp("us")
    return pa.date32() if kind in ("moment", "date") else pa.string()
