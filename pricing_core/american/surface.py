"""The value of one option over spots and times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.carry import carry_yield
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, SPOT, TOLERANCE
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.american.contracts.tolerances import check_moneyness
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.perpetual import perpetual_boundary
from pricing_core.american.engines.solve import solve
from pricing_core.american.price_book import checked_threads
from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError, NumericalError

SurfaceGreeks: TypeAlias = Literal["none", "standard"]
SURFACE_GREEKS = get_args(SurfaceGreeks)
GREEK_NAMES = ("delta", "gamma", "theta", "vega")


@dataclass(frozen=True, slots=True, eq=False)
class ValueSurface:
    """The option held to each time and seen from each spot. Money per unit of underlying.

    Parameters
    ----------
    time : Vector, shape (m,)
        Years from now.
    spot : Vector, shape (n,)
    value : Matrix, shape (m, n)
    delta, gamma, theta, vega : Matrix, shape (m, n), or None
        As in `Valuation`; None where no Greeks were asked for.
    multiplier : Matrix, shape (m, n)
        What a holder loses by not exercising, money per year: the slack of the equation of Black and Scholes, (11.46),
        r K - q S for a put and q S - r K for a call where exercise is optimal, of the escrowed model with the spot
        less the dividends due; 0 elsewhere, and where exercise is only possible at dates.
    exercised : bool array, shape (m, n)
        Whether exercise is optimal there.
    error_estimate : Matrix, shape (m, n)
        Error estimate of the value.
    perpetual_boundary : float or None
        The exercise boundary of the option without expiry; None where it is never exercised, or where dividends or
        curves leave it undefined.
    status : {"ok", "tolerance_not_met"}
        Whether every value meets the tolerance.
    method : str
        How the values were found, with commas where in several ways.
    """

    time: Vector
    spot: Vector
    value: Matrix
    delta: Matrix | None
    gamma: Matrix | None
    theta: Matrix | None
    vega: Matrix | None
    multiplier: Matrix
    exercised: NDArray[np.bool_]
    error_estimate: Matrix
    perpetual_boundary: float | None
    status: str
    method: str


def value_surface(
    option: Option,
    market: Market,
    *,
    spots: ArrayLike,
    times: ArrayLike,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: SurfaceGreeks = "standard",
    threads: int | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> ValueSurface:
    """Value the option at every pair of a time and a spot, just after what happens at that time.

    One solve per time serves all spots that are not far apart, and the solves of all times go side by side.

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
    greeks : {"none", "standard"}
        Whether delta, gamma, theta and vega come with the values.
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
    >>> surface.multiplier.tolist(), round(surface.perpetual_boundary, 2)
    ([[5.0, 0.0], [5.0, 0.0]], 71.43)
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    tolerance = TOLERANCE.check(tolerance)
    time, spot = as_vector("times", np.atleast_1d(times)), as_vector("spots", np.atleast_1d(spots))
    if np.any(time < 0.0) or np.any(time > option.expiry):
        raise InvalidInputError("times", times, "from 0 to the expiry")
    if greeks not in SURFACE_GREEKS:
        raise InvalidInputError("greeks", greeks, " or ".join(SURFACE_GREEKS))
    workers = checked_threads(threads)
    books = [_seen_from_spots(*seen_later(option, market, t), spot) for t in time.tolist()]
    book = Book.concatenated(books or [Book.of([])])
    request = Request(
        np.full(book.count, tolerance),
        greeks,
        share_solves=True,
        by_rates=False,
        threads=workers,
        interrupt=interrupt,
    )
    found = _priced(book, request)
    shape = (time.size, spot.size)
    wanted = {name: getattr(found, name).reshape(shape) if greeks != "none" else None for name in GREEK_NAMES}
    return ValueSurface(
        time,
        spot,
        found.value.reshape(shape),
        **wanted,
        multiplier=_multiplier(option, book, found).reshape(shape),
        exercised=found.exercised.reshape(shape),
        error_estimate=found.error.reshape(shape),
        perpetual_boundary=_perpetual_boundary(option, market),
        status="ok" if (found.status == "ok").all() else "tolerance_not_met",
        method=", ".join(sorted({*found.method.tolist()})),
    )


def _multiplier(option: Option, book: Book, found: Prices) -> Vector:
    """Return the multiplier of the complementarity problem, money per year, shape (n,)."""
    if option.exercise != "american":
        return np.zeros(book.count)
    now = book.now
    diffused = book.diffusing()
    slack = book.sign * (now.rate * book.strike - now.dividend_yield * diffused)
    discount = 1.0 if book.reduction is None else book.reduction.discount
    return np.where(found.exercised, discount * np.maximum(slack, 0.0), 0.0)


def _perpetual_boundary(option: Option, market: Market) -> float | None:
    if option.exercise != "american" or market.has_curves() or isinstance(market.volatility, LocalVolatility):
        return None
    if market.cash_dividends or market.proportional_dividends:
        return None
    ratio = perpetual_boundary(
        is_put=option.is_put,
        rate=float(market.rate),  # type: ignore[arg-type]
        dividend_yield=float(carry_yield(market)),  # type: ignore[arg-type]
        volatility=float(market.volatility),  # type: ignore[arg-type]
    )
    return option.strike * ratio if 0.0 < ratio < math.inf else None


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
    """Return the prices; contracts that differ in the spot alone share their solves."""
    prices = solve(book, request)
    if "deadline" in prices.status or (not prices.complete.all() and request.is_interrupted()):
        raise NumericalError("interrupted before all values were found: allow more time")
    for row in np.flatnonzero(np.isnan(prices.value)).tolist():
        raise InvalidInputError("spots", book.spot.item(row), str(prices.message[row]))
    return prices
