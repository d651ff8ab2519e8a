"""The table that `price_many` returns, and what fills its rows."""

from collections.abc import Container
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Rows
from pricing_core.american.book.prices import LISTS, NUMBERS, Prices
from pricing_core.american.book.valuation import DAYS_PER_YEAR
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.result_fields import price_fields
from pricing_core.arrays import Vector
from pricing_core.version import ENGINE_VERSION

Table: TypeAlias = dict[str, NDArray[Any]]

# Greeks in another unit: the Greek and what it is divided by.
IN_OTHER_UNITS = {
    "theta_per_day": ("theta", DAYS_PER_YEAR),
    "vega_per_point": ("vega", 100.0),
    "rho_per_point": ("rho", 100.0),
}


def empty_table(count: int, greeks: Greeks, columns: Container[str], *, greek_errors: bool) -> Table:
    """Return a table of so many rows that nothing is known of, with the columns of `price_many`.

    Parameters
    ----------
    columns : container of str
        Those of the table of contracts.
    """
    table: Table = {}
    for field in price_fields(greeks, columns, greek_errors=greek_errors):
        if field.kind == "number":
            table[field.name] = np.full(count, np.nan)
        elif field.kind == "flag":
            table[field.name] = np.zeros(count, dtype=bool)
        else:
            table[field.name] = np.full(count, "", dtype=object)
            if field.kind == "list":
                table[field.name].fill(())
    return table | {"message": np.full(count, "", dtype=object)}


def fill(table: Table, rows: Rows | slice, payoff: Vector, prices: Prices) -> None:
    """Write prices to rows of the table.

    Parameters
    ----------
    payoff : Vector
        What exercise brings now, money.
    """
    numbers = {
        "price": prices.value,
        "european_price": prices.european,
        "early_exercise_premium": prices.value - prices.european,
        "intrinsic_value": payoff,
        "exercise_boundary": prices.boundary,
        "error_estimate": prices.error,
    }
    numbers |= {name: getattr(prices, name) for name in NUMBERS if name in table}
    for name, (greek, share) in IN_OTHER_UNITS.items():
        if name in table:
            numbers[name] = numbers[greek] / share
    for name, column in numbers.items():
        table[name][rows] = column + 0.0  # no -0.0
    table["exercise_now"][rows] = prices.exercised
    for name in ("status", "method", "message"):
        table[name][rows] = getattr(prices, name)
    table["engine_version"][rows] = ENGINE_VERSION
    places = np.arange(next(iter(table.values())).size)[rows]
    for name in [name for name in LISTS if name in table]:
        column = getattr(prices, name)
        for row in np.flatnonzero(column.counts()).tolist():
            table[name][places[row]] = column.known_row(row)
