"""The value of one option over spots and times."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.american.contracts.contract import Option, check_kind
from pricing_core.american.contracts.market import FlatMarket, Market
from pricing_core.american.contracts.schedule import make_schedule, without_events
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.american.contracts.tolerances import DEFAULT_TOLERANCE
from pricing_core.american.events.scheduled import price_scheduled_many
from pricing_core.american.events.scheduled_book import scheduled_book
from pricing_core.american.price_many import price_many
from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError

FIELDS = ("price", "delta", "gamma", "exercise_now", "error_estimate")


@dataclass(frozen=True, slots=True, eq=False)
class ValueSurface:
    """The option held to each time and seen from each spot. Money per unit of underlying.

    Parameters
    ----------
    time : Vector, shape (m,)
        Years from now.
    spot : Vector, shape (n,)
    value, delta, gamma : Matrix, shape (m, n)
    exercised : bool array, shape (m, n)
        Whether exercise is optimal there.
    error_estimate : Matrix, shape (m, n)
        Of the value.
    """

    time: Vector
    spot: Vector
    value: Matrix
    delta: Matrix
    gamma: Matrix
    exercised: Matrix
    error_estimate: Matrix


def value_surface(
    option: Option,
    market: Market,
    *,
    spots: ArrayLike,
    times: ArrayLike,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> ValueSurface:
    """Value the option at every pair of a time and a spot, just after what happens at that time.

    Without events one solve per time serves all spots.

    Parameters
    ----------
    option : Option
    market : Market
        Its spot is not used.
    spots : array_like, shape (n,)
        Money, 0 to 1e30.
    times : array_like, shape (m,)
        Years from now, 0 to the expiry.
    tolerance : float
        As in `price`.
    threads : int, optional
        As in `price_many`.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.

    Examples
    --------
    >>> market = Market(spot=100.0, rate=0.05, volatility=0.2)
    >>> surface = value_surface(Option("put", 100.0, 1.0), market, spots=[80.0, 100.0], times=[0.0, 0.5])
    >>> surface.value.round(2).tolist(), surface.exercised.tolist()
    ([[20.0, 6.09], [20.0, 4.66]], [[True, False], [True, False]])
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    time, spot = as_vector("times", times), as_vector("spots", spots)
    if np.any(time < 0.0) or np.any(time > option.expiry):
        raise InvalidInputError("times", times, "from 0 to the expiry")
    plain = without_events(option, market)
    if plain is None:
        tables = [
            _priced(*seen_later(option, market, float(t)), spot, tolerance=tolerance, threads=threads)
            for t in time
        ]
        table = {name: np.concatenate([part[name] for part in tables]) for name in FIELDS}
    else:
        held, flat = plain
        rows = np.tile(spot, time.size)
        columns = {**_columns(held, flat), "spot": rows, "expiry": np.repeat(option.expiry - time, spot.size)}
        table = _table(columns, rows, tolerance, threads)
    shape = (time.size, spot.size)
    return ValueSurface(time, spot, *(table[name].reshape(shape) for name in FIELDS))


def _priced(
    option: Option, market: Market, spot: Vector, *, tolerance: float, threads: int | None
) -> dict[str, NDArray[Any]]:
    """Return the fields of one contract seen from every spot."""
    plain = without_events(option, market)
    if plain is not None:
        return _table({**_columns(*plain), "spot": spot}, spot, tolerance, threads)
    contracts = [(option, replace(market, spot=float(s))) for s in spot]
    for contract in contracts:
        try:
            make_schedule(*contract)
        except InvalidInputError as fault:  # escrowed dividends are worth the spot or more
            raise InvalidInputError("spots", contract[1].spot, _allowed(str(fault))) from None
    book, tolerances = scheduled_book(contracts), np.full(spot.size, tolerance)
    return _checked(price_scheduled_many(book, tolerances, greeks=False, threads=threads or 1), spot)


def _columns(option: Option, market: FlatMarket) -> dict[str, Any]:
    return {
        "option_type": option.option_type,
        "exercise": option.exercise,
        "strike": option.strike,
        "expiry": option.expiry,
        "rate": market.rate,
        "dividend_yield": market.dividend_yield,
        "volatility": market.volatility,
    }


def _table(
    columns: dict[str, Any], spot: Vector, tolerance: float, threads: int | None
) -> dict[str, NDArray[Any]]:
    table = price_many(columns, tolerance=tolerance, greeks=False, threads=threads, share_solves=True)
    return _checked(table, spot)


def _checked(table: dict[str, NDArray[Any]], spot: Vector) -> dict[str, NDArray[Any]]:
    refused = np.flatnonzero(np.isnan(table["price"]))
    if refused.size:
        row = int(refused[0])
        raise InvalidInputError("spots", float(spot[row]), _allowed(str(table["message"][row])))
    return table


def _allowed(message: str) -> str:
    """Return what a refusal allows; the whole message where it says no range."""
    return message.rpartition(": must be ")[2]
