"""The value of one option over spots and times."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, SPOT, TOLERANCE
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.american.contracts.tolerances import check_moneyness
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.american.price_book import checked_threads
from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError, NumericalError


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
        Error estimate of the value.
    """

    time: Vector
    spot: Vector
    value: Matrix
    delta: Matrix
    gamma: Matrix
    exercised: NDArray[np.bool_]
    error_estimate: Matrix


def value_surface(
    option: Option,
    market: Market,
    *,
    spots: ArrayLike,
    times: ArrayLike,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
    interrupt: Callable[[], bool] | None = None,
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
    interrupt : callable, optional
        Asked between steps of the work; True ends it.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.
    NumericalError
        The interrupt came before the end.

    Examples
    --------
    >>> market = Market(spot=100.0, rate=0.05, volatility=0.2)
    >>> surface = value_surface(Option("put", 100.0, 1.0), market, spots=[80.0, 100.0], times=[0.0, 0.5])
    >>> surface.value.round(2).tolist(), surface.exercised.tolist()
    ([[20.0, 6.09], [20.0, 4.66]], [[True, False], [True, False]])
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    tolerance = TOLERANCE.check(tolerance)
    time, spot = as_vector("times", np.atleast_1d(times)), as_vector("spots", np.atleast_1d(spots))
    if np.any(time < 0.0) or np.any(time > option.expiry):
        raise InvalidInputError("times", times, "from 0 to the expiry")
    workers = checked_threads(threads)
    books = [_seen_from_spots(*seen_later(option, market, t), spot) for t in time.tolist()]
    book = Book.of([])
    for part in books:
        book = book.joined(part)
    request = Request(
        np.full(book.count, tolerance), "none", share_solves=True, threads=workers, interrupt=interrupt
    )
    found = _priced(book, request)
    shape = (time.size, spot.size)
    return ValueSurface(
        time,
        spot,
        found.value.reshape(shape),
        found.delta.reshape(shape),
        found.gamma.reshape(shape),
        found.exercised.reshape(shape),
        found.error.reshape(shape),
    )


def _seen_from_spots(option: Option, market: Market, spot: Vector) -> Book:
    """Return the contract seen from every spot."""
    book = Book.at_strike(option, market)
    least = book.escrow_now().item()
    for number in spot.tolist():
        SPOT.check(number, "spots")
        check_moneyness(option, number, "spots")
    for refused in spot[(least > 0.0) & (spot <= least)].tolist():
        raise InvalidInputError("spots", refused, f"above what the escrowed dividends are worth, {least:g}")
    return replace(book.take(np.zeros(spot.size, dtype=np.intp)), spot=spot)


def _priced(book: Book, request: Request) -> Prices:
    """Return the prices; contracts without events that differ in the spot alone share their solves."""
    prices = solve(book, request)
    if "deadline" in prices.status:
        raise NumericalError("interrupted before all values were found: allow more time")
    for row in np.flatnonzero(np.isnan(prices.value)).tolist():
        raise InvalidInputError("spots", book.spot.item(row), str(prices.message[row]))
    return prices
