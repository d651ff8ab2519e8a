"""Calls and puts of one strike and expiry, read from the quotes of one underlying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.columns import as_numbers, broadcast_columns
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import EXPIRY, STRIKE
from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.volatility_bounds import ANY_VOLATILITY
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

CONTRACTS = ("option_type", "strike", "expiry")
PRICES = ("option_price", "bid", "ask")
SHARED = ("spot", "rate")
DIVIDENDS = ("cash_dividends", "proportional_dividends", "dividend_model")
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


def read_chain(chain: Mapping[str, Any]) -> Chain:
    """Return the pairs with two prices above 0; other rows take no part.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, lengths differ, or what the options share is outside what is allowed.
    """
    check_kind("chain", chain, Mapping, "a mapping of names to columns")
    _check_names(chain)
    market = Market(
        chain["spot"],
        chain["rate"],
        ANY_VOLATILITY,
        **{name: chain[name] for name in DIVIDENDS if chain.get(name) is not None},
    )
    if market.spot == 0.0:
        raise InvalidInputError("spot", chain["spot"], "a number above 0")
    exercise = chain.get("exercise", "american")
    if exercise not in ("american", "european"):
        raise InvalidInputError("exercise", exercise, '"american" or "european", for the whole chain')
    table = broadcast_columns({name: chain[name] for name in (*CONTRACTS, *PRICES) if name in chain})
    numbers = {name: as_numbers(column) for name, column in table.items() if name != "option_type"}
    with np.errstate(all="ignore"):
        sound, price, width = _quotes(numbers)
    expiry = numbers["expiry"]
    expiries = np.unique(expiry[(expiry > 0.0) & (expiry <= EXPIRY.most)])
    sides = [np.flatnonzero(sound & (table["option_type"] == side)) for side in ("call", "put")]
    return Chain(expiries, _match(sides, numbers, price, width, expiries), market, exercise)


def _check_names(chain: Mapping[str, Any]) -> None:
    for name in chain:
        if name not in (*CONTRACTS, *PRICES, *SHARED, *DIVIDENDS, "exercise"):
            names = ", ".join((*CONTRACTS, *PRICES, *SHARED, *DIVIDENDS, "exercise"))
            raise InvalidInputError("chain", name, f"named {names}")
    for name in (*CONTRACTS, *SHARED):
        if name not in chain:
            raise InvalidInputError(name, "missing", "given")
    given = {name for name in PRICES if name in chain}
    if given not in ({"option_price"}, {"bid", "ask"}):
        raise InvalidInputError("chain", ", ".join(sorted(given)), "option_price alone, or bid and ask")


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
