"""What is known of the European option without a grid: from the formula, or from an engine that prices it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.engine import Engine, Request
from pricing_core.american.engines.held import charm_weights
from pricing_core.american.engines.method_of_lines.tangents import Direction
from pricing_core.arrays import Matrix, Vector

CONTROL_SHARE = 0.01  # Tolerance of the control over that of the price; chosen.


class Known(NamedTuple):
    """The European option's v, v_s, v_ss, v_sss in units of the strike, then their derivatives by P parameters.

    Parameters
    ----------
    values : Matrix, shape (1 + P, 4)
        NaN where nothing is known.
    errors : Matrix, shape (1 + P, 4)
    """

    values: Matrix
    errors: Matrix


def known_of(
    book: Book, directions: tuple[Direction, ...], request: Request, control: Engine | None
) -> Known | None:
    """Return what the formula knows of a book of one contract, or else the control; None where neither does.

    With a local volatility, the option at the volatility that stands for it, without derivatives: what a solve on the
    same grid misses of it, that of the local volatility misses nearly as well.

    Parameters
    ----------
    directions : tuple of Direction
        The P parameters.
    control : Engine, optional
        Asked where cash dividends leave no formula.
    """
    local = book.local is not None
    request = replace(request, greeks=request.greeks if directions and not local else "none")
    if not (book.drops() > 0.0).any():
        flat = replace(book, local=None) if local else book
        found = prices(1, **european_columns(flat, request.greeks))
        return _in_strikes(flat, found, directions)
    held = book.european()
    if local or control is None or not control.serves(held)[0]:
        return None
    found = control.solve(held, replace(request, tolerance=CONTROL_SHARE * request.tolerance))
    known = found.settled[0] and found.error[0] <= request.tolerance[0] * book.strike[0]
    return _in_strikes(held, found, directions) if known else None


def _in_strikes(book: Book, found: Prices, directions: tuple[Direction, ...]) -> Known:
    """Return the prices of one European option in units of the strike."""
    strike = book.strike.item(0)
    values, errors = np.full((2, 1 + len(directions), 4), math.nan)
    values[0, :3] = found.value[0] / strike, found.delta[0], found.gamma[0] * strike
    errors[0, :3] = found.error[0] / strike, found.delta_error[0], found.gamma_error[0] * strike
    by_delta, by_gamma, by_third = (weight.item(0) for weight in charm_weights(book))
    if by_third != 0.0:
        third = (found.charm[0] - by_delta * found.delta[0] - by_gamma * found.gamma[0]) / by_third
        values[0, 3] = third * strike**2
    for row, direction in enumerate(directions, start=1):
        for numbers, name in ((values, direction.kind), (errors, error_of(direction.kind))):
            numbers[row, 0] = _entry(getattr(found, name), direction.entry) / strike
        if direction.kind == "vega":
            values[row, 1], errors[row, 1] = found.vanna[0], found.vanna_error[0]
    return Known(values, np.nan_to_num(errors))


def _entry(column: Vector | Ragged, place: int) -> float:
    """Return a number of a column, NaN where the column is not there."""
    numbers = column.values if isinstance(column, Ragged) else column
    return numbers.item(place) if place < numbers.size else math.nan
