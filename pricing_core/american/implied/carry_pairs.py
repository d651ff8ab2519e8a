"""Calls and puts of one strike and expiry, read from the quotes of one underlying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.array_column import ArrayColumn
from pricing_core.american.book.columns import as_numbers, broadcast_columns, is_list_of_row
from pricing_core.american.book.reading import read_dates
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import EXERCISE, EXPIRY, OPTION_TYPE, STRIKE, input_field
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.names import DATES_INSTEAD
from pricing_core.american.contracts.vocabulary import DATES, LISTS
from pricing_core.american.implied.volatility_targets import ANY_VOLATILITY
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError, MissingInputError, Told, UnknownNameError
from pricing_core.extras import needs_extra

CONTRACTS = ("option_type", "strike", "expiry")
PRICES = ("option_price", "bid", "ask")
SHARED = ("spot", "rate")
DIVIDENDS = ("cash_dividends", "proportional_dividends", "dividend_model")
OPTIONAL = ("exercise", "valuation_date", *DIVIDENDS)
NAMES = (*CONTRACTS, *DATES, *PRICES, *SHARED, "exercise", *DIVIDENDS)
NARROWEST = 1e-9  # Smallest width of a quote that counts, in strikes; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Quotes of a call and a put each; every array has shape (m,), money per unit of underlying.

    Parameters
    ----------
    group : int array
        Which expiry of the chain.
    strike, expiry, call, put : Vector
        The prices are mids where there are quotes.
    width : Vector
        Half the sum of both quotes' widths: as far as call - put may be off.
    """

    group: NDArray[np.intp]
    strike: Vector
    expiry: Vector
    call: Vector
    put: Vector
    width: Vector

    def take(self, rows: NDArray[Any]) -> Pairs:
        """Return some of the pairs."""
        return Pairs(*(getattr(self, name)[rows] for name in self.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The pairs of a chain, and what its options share.

    Parameters
    ----------
    expiries : Vector, shape (n,)
        All of the chain's, in order.
    pairs : Pairs
    market : Market
        Without dividend yield and volatility.
    exercise : {"american", "european"}
    """

    expiries: Vector
    pairs: Pairs
    market: Market
    exercise: str


def read_chain(chain: Any) -> Chain:
    """Return the pairs with two prices above 0; other rows take no part.

    Parameters
    ----------
    chain : mapping of str, or a frame
        As in `implied_carry`.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, lengths differ, or what the options share is outside what is allowed.
    """
    if hasattr(chain, "__arrow_c_stream__"):
        with needs_extra("batch"):
            from pricing_core.american.arrow.frames import cells_of, known_frame, names_of  # noqa: PLC0415
        table = known_frame(chain)
        chain = {name: cells_of(table, name) for name in names_of(table) if name in NAMES}
    check_kind("chain", chain, Mapping, "a mapping of names to columns, or a frame")
    _check_names(chain)
    shared = {name: _shared(name, chain[name]) for name in (*SHARED, *OPTIONAL) if name in chain}
    exercise = EXERCISE.check_choice(shared.pop("exercise", EXERCISE.default))
    if exercise == "bermudan":
        raise InvalidInputError("exercise", exercise, '"american" or "european", for the whole chain')
    market = Market(
        **{name: value for name, value in shared.items() if value is not None}, volatility=ANY_VOLATILITY
    )
    if market.spot == 0.0:
        raise InvalidInputError("spot", market.spot, "a number above 0")
    columns = broadcast_columns(
        {name: chain[name] for name in (*CONTRACTS, *DATES, *PRICES) if name in chain}
    )
    numbers = {name: as_numbers(columns[name]) for name in ("strike", "expiry", *PRICES) if name in columns}
    expiry = numbers.setdefault("expiry", np.full(columns["strike"].size, np.nan))
    if any(name in columns for name in DATES):
        read_dates({name: ArrayColumn(input_field(name), columns[name]) for name in DATES}, expiry)
    with np.errstate(all="ignore"):
        sound, price, width = _quotes(numbers)
    expiries = np.unique(expiry[(expiry > 0.0) & (expiry <= EXPIRY.most)])
    words = ArrayColumn(OPTION_TYPE, columns["option_type"]).words()
    sides = [np.flatnonzero(sound & (words == OPTION_TYPE.choices.index(side))) for side in ("call", "put")]
    return Chain(expiries, _match(sides, numbers, price, width, expiries), market, exercise)


def _check_names(chain: Mapping[str, Any]) -> None:
    unknown = [str(name) for name in chain if name not in NAMES]
    if unknown:
        raise UnknownNameError("column", unknown, NAMES, "a chain")
    dated = all(name in chain for name in DATES)
    needed = [name for name in (*CONTRACTS, *SHARED) if not (dated and name == "expiry")]
    missing = {name: DATES_INSTEAD if name == "expiry" else "" for name in needed if name not in chain}
    if missing:
        raise MissingInputError(missing)
    given = {name for name in PRICES if name in chain}
    if given not in ({"option_price"}, {"bid", "ask"}):
        raise InvalidInputError("chain", ", ".join(sorted(given)), "option_price alone, or bid and ask")


def _shared(name: str, value: Any) -> Any:
    """Return what all rows share: a value, or that of a column in which it is the same in every row."""
    is_array = hasattr(value, "tolist") and np.ndim(value) > 0  # of NumPy, or a series of pandas or polars
    cells = [*value] if is_array or isinstance(value, list | tuple) else None
    if cells is None or (name in LISTS and not any(is_list_of_row(name, cell) for cell in cells)):
        return value
    first = cells[0] if cells else None
    if any(cell != first for cell in cells):
        raise InvalidInputError(name, Told("different values"), "the same in every row of a chain")
    return first


def _quotes(numbers: Mapping[str, Vector]) -> tuple[BoolVector, Vector, Vector]:
    """Return which rows can be used, their prices and the widths of their quotes."""
    strike, expiry = numbers["strike"], numbers["expiry"]
    sound = (strike >= STRIKE.least) & (strike <= STRIKE.most) & (expiry > 0.0) & (expiry <= EXPIRY.most)
    if "option_price" in numbers:
        price = numbers["option_price"]
        return sound & (price > 0.0) & (price < np.inf), price, np.zeros_like(price)
    bid, ask = numbers["bid"], numbers["ask"]
    sound &= (bid > 0.0) & (ask >= bid) & (ask < np.inf)
    return sound, 0.5 * (bid + ask), ask - bid


def _match(
    sides: list[NDArray[np.intp]],
    numbers: Mapping[str, Vector],
    price: Vector,
    width: Vector,
    expiries: Vector,
) -> Pairs:
    """Return the calls and puts of one strike and expiry; of several quotes of one option the narrowest counts."""
    keys: list[dict[tuple[float, float], int]] = []
    for rows in sides:
        widest_first = rows[np.argsort(-width[rows], kind="stable")].tolist()
        keys.append({(numbers["expiry"].item(row), numbers["strike"].item(row)): row for row in widest_first})
    common = sorted(keys[0].keys() & keys[1].keys())
    call, put = (np.array([side[key] for key in common], dtype=np.intp) for side in keys)
    expiry, strike = np.array(common, dtype=np.float64).reshape(-1, 2).T
    return Pairs(
        np.searchsorted(expiries, expiry),
        strike,
        expiry,
        price[call],
        price[put],
        np.maximum(0.5 * (width[call] + width[put]), NARROWEST * strike),
    )
