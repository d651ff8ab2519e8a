"""The table that `price_many` returns, and what fills its rows."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.priced_rows import PricedRows
from pricing_core.american.results import DAYS_PER_YEAR, Valuation
from pricing_core.arrays import Vector
from pricing_core.version import ENGINE_VERSION

NUMBERS = (
    "price",
    "european_price",
    "early_exercise_premium",
    "intrinsic_value",
    "delta",
    "gamma",
    "theta",
    "theta_per_day",
    "vega",
    "vega_per_point",
    "rho",
    "rho_per_point",
    "dividend_rho",
    "exercise_boundary",
    "error_estimate",
)
TEXTS = ("status", "method", "engine_version", "message")
SENSITIVITIES = "dividend_sensitivities"
Table: TypeAlias = dict[str, NDArray[Any]]


def empty_table(count: int) -> Table:
    """Return a table of so many rows that nothing is known of."""
    table: Table = dict(zip(NUMBERS, np.full((len(NUMBERS), count), np.nan), strict=True))
    table["exercise_now"] = np.zeros(count, dtype=bool)
    table |= {name: np.full(count, "", dtype=object) for name in TEXTS}
    table[SENSITIVITIES] = np.full(count, None, dtype=object)
    table[SENSITIVITIES].fill(())
    return table


def fill_rows(
    table: Table,
    rows: NDArray[np.intp] | slice,
    priced: PricedRows,
    *,
    payoff: Vector,
    tolerance: Vector,
    method: str,
) -> None:
    """Write prices to rows of the table.

    Parameters
    ----------
    payoff, tolerance : Vector
        Money.
    """
    numbers = {
        "price": priced.value,
        "european_price": priced.european,
        "early_exercise_premium": priced.value - priced.european,
        "intrinsic_value": payoff,
        "delta": priced.delta,
        "gamma": priced.gamma,
        "theta": priced.theta,
        "theta_per_day": priced.theta / DAYS_PER_YEAR,
        "vega": priced.vega,
        "vega_per_point": priced.vega / 100.0,
        "rho": priced.rho,
        "rho_per_point": priced.rho / 100.0,
        "dividend_rho": priced.dividend_rho,
        "exercise_boundary": priced.boundary,
        "error_estimate": priced.error,
    }
    for name, column in numbers.items():
        table[name][rows] = column + 0.0  # no -0.0
    table["exercise_now"][rows] = priced.exercised
    status = np.full(payoff.size, "ok", dtype=object)  # one text for all rows, not one per row
    status[priced.error > tolerance] = "tolerance_not_met"
    table["status"][rows] = status
    table["method"][rows] = method
    table["engine_version"][rows] = ENGINE_VERSION


def fill_row(table: Table, row: int, valuation: Valuation) -> None:
    """Write a valuation to a row of the table; where there is no price, what diagnoses it is the message."""
    for name in NUMBERS:
        number = getattr(valuation, name)
        table[name][row] = np.nan if number is None else number
    table["exercise_now"][row] = valuation.exercise_now
    for name in TEXTS[:3]:
        table[name][row] = getattr(valuation, name)
    table[SENSITIVITIES][row] = valuation.dividend_sensitivities or ()
    if valuation.price is None:
        table["message"][row] = valuation.diagnostics.solved_by
