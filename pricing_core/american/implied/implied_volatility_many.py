"""The implied volatilities of a table of quotes, one status per row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.columns import as_numbers, broadcast_columns, plain
from pricing_core.american.book.reading import ReadBook, read_book
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, TOLERANCE, input_field
from pricing_core.american.engines.chunks import mapped
from pricing_core.american.implied.volatility_pricers import find_volatilities
from pricing_core.american.implied.volatility_search import (
    INVALID,
    STATUSES,
    FoundVolatilities,
    nothing_found,
    why_none,
)
from pricing_core.american.implied.volatility_targets import ANY_VOLATILITY
from pricing_core.american.price_book import checked_threads
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError
from pricing_core.extras import needs_extra

if TYPE_CHECKING:
    from pricing_core.american.arrow.frames import AnyFrame

PRICES = ("option_price", "bid", "ask")

# Number of contracts searched at a time, so that their columns stay in the cache; measured.
LARGEST_CHUNK = 16384
SMALLEST_CHUNK = 256  # Number of contracts: fewer are not worth a thread; measured.


@overload
def implied_volatility_many(
    columns: Mapping[str, Any],
    option_price: Any = None,
    *,
    bid: Any = None,
    ask: Any = None,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> dict[str, NDArray[Any]]: ...


@overload
def implied_volatility_many(
    columns: AnyFrame,
    option_price: Any = None,
    *,
    bid: Any = None,
    ask: Any = None,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> AnyFrame: ...


def implied_volatility_many(
    columns: Any,
    option_price: Any = None,
    *,
    bid: Any = None,
    ask: Any = None,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> Any:
    """Return one implied volatility per row; a bad row gets a status and a message, never an exception.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar; or a frame
        The columns of `price_many`; a volatility is not needed, and ignored. The prices may be among them, as
        option_price or as bid and ask, where none is given as an argument.
    option_price : array_like, shape (n,), or scalar, optional
        Money per unit of underlying, >= 0.
    bid, ask : array_like, shape (n,), or scalar, optional
        In the place of option_price, whose part their mean takes; 0 <= bid <= ask, ask > 0.
    tolerance : float
        For rows without a tolerance of their own, as in `implied_volatility`.
    threads : int, optional
        How many to use, >= 1; one by default. The results do not depend on it.

    Returns
    -------
    dict of str to array, shape (n,)
        The fields of `ImpliedVolatility` by name, missing numbers NaN; the message is also the reason where the status
        is "invalid_input"; bid_volatility and ask_volatility where bid and ask are given. A row's numbers do not
        depend on the other rows. A frame comes back as one of its kind, with these as further columns.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ; tolerance or threads out of range; both or neither of
        price and quote are given.

    Examples
    --------
    >>> quotes = {"option_type": "put", "spot": 100.0, "strike": [90.0, 100.0, 140.0], "expiry": 1.0, "rate": 0.05}
    >>> table = implied_volatility_many(quotes, option_price=[2.4, 6.0904, 40.0])
    >>> table["volatility"].round(3).tolist(), table["status"].tolist()
    ([0.197, 0.2, nan], ['ok', 'ok', 'not_identifiable'])
    """
    tolerance = TOLERANCE.check(tolerance)
    workers = checked_threads(threads)
    given = {"option_price": option_price, "bid": bid, "ask": ask}
    prices = {name: column for name, column in given.items() if column is not None}
    if hasattr(columns, "__arrow_c_stream__"):
        with needs_extra("batch"):
            from pricing_core.american.implied.implied_frames import implied_frame  # noqa: PLC0415
        return implied_frame(columns, prices, tolerance, workers)
    check_kind("columns", columns, Mapping, "a mapping of names to columns, or a frame")
    prices = prices or {name: columns[name] for name in PRICES if name in columns}
    cells, sides = observed_prices(prices)
    contracts = {name: column for name, column in columns.items() if name not in PRICES}
    read = read_book({**contracts, "volatility": ANY_VOLATILITY}, tolerance)
    if read.count == 1 and sides.shape[1] != 1:  # one contract, many prices
        read = read_book({**contracts, "volatility": np.full(sides.shape[1], ANY_VOLATILITY)}, tolerance)
    return volatilities_of(read, cells, sides, workers)


def volatilities_of(
    read: ReadBook, cells: Mapping[str, NDArray[Any]], sides: NDArray[np.float64], workers: int
) -> dict[str, NDArray[Any]]:
    """Return the columns of the result for contracts and what `observed_prices` has made of their prices."""
    count = sides.shape[1]
    if count not in (1, read.count):
        raise InvalidInputError(
            "option_price, bid, ask", f"{count} rows", f"one, or as many as columns: {read.count}"
        )
    cells = {name: np.broadcast_to(column, (read.count,)) for name, column in cells.items()}
    sides = np.broadcast_to(sides, (sides.shape[0], read.count))
    faults = read.faults | _faults(cells, sides, read.faults)
    found = [_find(read, prices, [*faults], workers) for prices in sides]
    messages = {row: str(fault) for row, fault in sorted(faults.items())}
    for row in np.flatnonzero(~np.isnan(found[0].price_bound)).tolist():
        messages[row] = why_none(
            STATUSES[found[0].status[row]], sides[0, row], found[0].price_bound.item(row)
        )
    return _table(found, messages)


def observed_prices(given: Mapping[str, Any]) -> tuple[dict[str, NDArray[Any]], NDArray[np.float64]]:
    """Return the columns as they are given, and prices, or mids, bids and asks, NaN where one is not allowed.

    Raises
    ------
    InvalidInputError
        There are both or neither of price and quote, or lengths differ.
    """
    if set(given) not in ({"option_price"}, {"bid", "ask"}):
        names = ", ".join(given) or "none of them"
        raise InvalidInputError("option_price, bid, ask", names, "option_price alone, or bid and ask")
    cells = broadcast_columns(given)
    numbers = {name: as_numbers(column) for name, column in cells.items()}
    with np.errstate(all="ignore"):
        if "option_price" in given:
            rows = numbers["option_price"].reshape(1, -1)
            bad = ~((rows[0] >= 0.0) & (rows[0] < np.inf))
        else:
            low, high = numbers["bid"], numbers["ask"]
            rows = np.stack([0.5 * (low + high), low, high])
            bad = ~((low >= 0.0) & (low <= high) & (high > 0.0) & (high < np.inf))
    rows[:, bad] = np.nan
    return cells, rows


def _faults(
    cells: Mapping[str, NDArray[Any]], sides: NDArray[np.float64], known: Mapping[int, InvalidInputError]
) -> dict[int, InvalidInputError]:
    """Return by row what is wrong with the prices."""
    faults = {}
    for row in np.flatnonzero(np.isnan(sides[0])).tolist():
        if row not in known:
            faults[row] = _fault({name: plain(column[row]) for name, column in cells.items()})
    return faults


def _fault(quote: Mapping[str, Any]) -> InvalidInputError:
    try:
        numbers = {name: input_field(name).check(cell) for name, cell in quote.items()}
    except InvalidInputError as fault:
        return fault
    return InvalidInputError("ask", quote["ask"], f"above 0 and at least the bid, {numbers['bid']:g}")


def _find(read: ReadBook, prices: Vector, refused: list[int], workers: int) -> FoundVolatilities:
    """Search every row that is not refused."""
    found = nothing_found(prices.size, INVALID)
    wanted = np.ones(prices.size, dtype=bool)
    wanted[refused] = False
    places = np.flatnonzero(wanted[read.rows])
    size = min(LARGEST_CHUNK, max(SMALLEST_CHUNK, -(-places.size // workers)))
    parts = [places[start : start + size] for start in range(0, places.size, size)]

    def search(part: NDArray[np.intp]) -> None:
        rows = read.rows[part]
        found.store(rows, find_volatilities(read.book.take(part), prices[rows], read.tolerance[part]))

    mapped(search, parts, workers)
    return found


def _table(sides: list[FoundVolatilities], messages: Mapping[int, str]) -> dict[str, NDArray[Any]]:
    """Return the columns of the result; `sides` holds prices, or mids, bids and asks."""
    middle = sides[0]
    message = np.full(middle.status.size, "", dtype=object)
    for row, text in messages.items():
        message[row] = text
    table = {
        "volatility": middle.volatility,
        "status": np.array(STATUSES, dtype=object)[middle.status],
        "european_price": middle.european,
        "price": middle.price,
        "error_estimate": middle.error,
        "volatility_error": middle.volatility_error,
        "iterations": middle.pricings,
        "method": middle.method,
        "price_bound": middle.price_bound,
        "message": message,
    }
    for name, side in zip(("bid_volatility", "ask_volatility"), sides[1:], strict=False):
        table[name] = side.volatility
    return table
