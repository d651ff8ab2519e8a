"""The search for volatilities with this library's pricers: books all at once, contracts with events, what is left."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import make_schedule, without_events
from pricing_core.american.events.scheduled import price_scheduled_many
from pricing_core.american.events.scheduled_book import scheduled_book
from pricing_core.american.implied.volatility_bounds import book_bounds, join_bounds, schedule_bounds
from pricing_core.american.implied.volatility_search import (
    NO_CONVERGENCE,
    NOT_SERVED,
    Found,
    Pricer,
    Prices,
    search,
)
from pricing_core.american.implied.volatility_targets import Targets
from pricing_core.american.results import Valuation
from pricing_core.american.solver_settings import SolverSettings
from pricing_core.american.tables.book import Book, single_row
from pricing_core.american.tables.book_values import value_book
from pricing_core.american.valuation import march_value, price_alone
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError

ANY_VOLATILITY = 0.2  # stands in for the one that is looked for


def find_volatilities(
    option: Option,
    market: Market,
    prices: Vector,
    tolerance: float,
    interrupt: Callable[[], bool] | None = None,
) -> Found:
    """Search the volatilities of several prices of one option; arguments as `implied_volatility` checks them.

    Parameters
    ----------
    prices : Vector, shape (n,)
    """
    market = replace(market, volatility=ANY_VOLATILITY)
    simple = without_events(option, market)
    if simple is None:
        contracts = [(option, market)] * prices.size
        return find_with_events(contracts, prices, np.full(prices.size, tolerance), interrupt=interrupt)
    book = single_row(*simple, tolerance).take(np.zeros(prices.size, dtype=np.intp))
    return find_in_book(book, prices, interrupt)


def find_in_book(book: Book, prices: Vector, interrupt: Callable[[], bool] | None = None) -> Found:
    """Search the volatilities of options without events, all at once.

    Parameters
    ----------
    book : Book
        Its volatilities are ignored.
    prices : Vector, shape (n,)
    """

    def price_at(rows: NDArray[np.intp], volatility: Vector, tolerance: Vector, with_vega: bool) -> Prices:
        part = replace(book.take(rows), volatility=volatility, tolerance=tolerance)
        values = value_book(part, greeks=with_vega, threads=1, shared=False)
        return Prices(values.value, values.european, values.vega, values.error)

    found = search(_targets(book, prices), price_at)
    left = np.flatnonzero(found.status == NOT_SERVED)
    if left.size:
        found.store(left, _find_left(book.take(left), prices[left], interrupt))
    return found


def _find_left(book: Book, prices: Vector, interrupt: Callable[[], bool] | None) -> Found:
    """Search those that the march does not serve at some volatility, each price a call of its own."""

    def value_at(row: int, volatility: float, tolerance: float) -> Valuation | None:
        option, market = book.option(row), replace(book.market(row), volatility=volatility)
        marched = march_value(option, market, tolerance, False)
        if marched is not None:
            return marched
        try:
            settings = SolverSettings(tolerance, greeks=False, interrupt=interrupt)
            return price_alone(option, market, settings)
        except (InvalidInputError, ArithmeticError):  # out of what the engine can do
            return None

    def price_at(rows: NDArray[np.intp], volatility: Vector, tolerance: Vector, _: bool) -> Prices:
        cells = zip(rows.tolist(), volatility.tolist(), tolerance.tolist(), strict=True)
        return _prices([value_at(*cell) for cell in cells])

    return _search_all(_targets(book, prices), price_at)


def find_with_events(
    contracts: Sequence[tuple[Option, Market]],
    prices: Vector,
    tolerance: Vector,
    *,
    threads: int = 1,
    interrupt: Callable[[], bool] | None = None,
) -> Found:
    """Search the volatilities of contracts with events, all at once.

    Parameters
    ----------
    contracts : sequence of (Option, Market)
        The volatilities are ignored; without escrowed dividends that are worth the spot.
    prices, tolerance : Vector, shape (n,)
    threads : int
    interrupt : callable, optional
        Asked before every round of prices, and before every time step of the general path.
    """
    bounds = [schedule_bounds(make_schedule(option, market)) for option, market in contracts]
    spot = np.array([market.spot for _, market in contracts])
    strike, expiry = (np.array([getattr(o, name) for o, _ in contracts]) for name in ("strike", "expiry"))
    targets = Targets(prices, join_bounds(bounds), spot, strike, expiry, tolerance)

    def price_at(rows: NDArray[np.intp], volatility: Vector, tolerance: Vector, _: bool) -> Prices:
        if interrupt is not None and interrupt():
            return Prices(*np.full((4, rows.size), np.nan))
        trial = [
            (contracts[row][0], replace(contracts[row][1], volatility=number))
            for row, number in zip(rows.tolist(), volatility.tolist(), strict=True)
        ]
        table = price_scheduled_many(
            scheduled_book(trial), tolerance, greeks=False, threads=threads, interrupt=interrupt
        )
        no_vega = np.full(rows.size, np.nan)
        return Prices(table["price"], table["european_price"], no_vega, table["error_estimate"])

    return _search_all(targets, price_at)


def _targets(book: Book, prices: Vector) -> Targets:
    return Targets(prices, book_bounds(book), book.spot, book.strike, book.expiry, book.tolerance)


def _search_all(targets: Targets, price_at: Pricer) -> Found:
    """Search where no other pricer is left."""
    found = search(targets, price_at)
    found.status[found.status == NOT_SERVED] = NO_CONVERGENCE
    return found


def _prices(valuations: Sequence[Valuation | None]) -> Prices:
    """Return the valuations as columns, without vega."""
    value, european, error = np.full((3, len(valuations)), np.nan)
    for row, valuation in enumerate(valuations):
        if valuation is not None and valuation.price is not None and valuation.error_estimate is not None:
            value[row], error[row] = valuation.price, valuation.error_estimate
            european[row] = math.nan if valuation.european_price is None else valuation.european_price
    return Prices(value, european, np.full(len(valuations), np.nan), error)
