"""Price a table of options, one status per row."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contract import Option, real_number
from pricing_core.american.market import Market
from pricing_core.american.results import Valuation
from pricing_core.american.valuation import (
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
    price,
)
from pricing_core.errors import InvalidInputError

OPTION_COLUMNS = ("option_type", "strike", "expiry", "exercise")
MARKET_COLUMNS = ("spot", "rate", "volatility", "dividend_yield")
REQUIRED_COLUMNS = ("option_type", "spot", "strike", "expiry", "rate", "volatility")
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


def price_many(
    columns: Mapping[str, Any],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: bool = True,
    threads: int | None = None,
) -> dict[str, NDArray[Any]]:
    """Price one option per row; a bad row gets a status and a message, never an exception.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
        option_type, spot, strike, expiry, rate, volatility, and optionally exercise, dividend_yield and
        tolerance.
    tolerance : float
        For rows without a tolerance of their own.
    greeks : bool
        False leaves out vega, rho and dividend rho.
    threads : int, optional
        Rows priced at a time, >= 1; the results do not depend on it.

    Returns
    -------
    dict of str to array, shape (n,)
        The fields of `Valuation` by name, missing numbers NaN, and "message", the reason where status is
        "invalid_input".

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ.

    Examples
    --------
    >>> book = {"option_type": "put", "spot": [90.0, -1.0], "strike": 100.0, "expiry": 1.0}
    >>> table = price_many({**book, "rate": 0.05, "volatility": 0.2}, tolerance=1e-4)
    >>> table["status"].tolist(), table["message"][1]
    (['ok', 'invalid_input'], 'spot = -1.0: must be a number from 0 to 1e+30')
    """
    real_number("tolerance", tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
    if threads is not None and (not isinstance(threads, int) or threads < 1):
        raise InvalidInputError("threads", threads, "an integer >= 1")
    table = _broadcast(columns)
    rows = [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)]

    def price_row(row: dict[str, Any]) -> Valuation | InvalidInputError | ArithmeticError:
        try:
            option = Option(**{name: row[name] for name in OPTION_COLUMNS if name in row})
            market = Market(**{name: row[name] for name in MARKET_COLUMNS if name in row})
            return price(option, market, tolerance=row.get("tolerance", tolerance), greeks=greeks)
        except (InvalidInputError, ArithmeticError) as error:
            return error

    return _collect(_map_rows(price_row, rows, threads))


def _map_rows(
    price_row: Callable[[dict[str, Any]], Valuation | InvalidInputError | ArithmeticError],
    rows: list[dict[str, Any]],
    threads: int | None,
) -> list[Valuation | InvalidInputError | ArithmeticError]:
    if threads is None or threads == 1:
        return [price_row(row) for row in rows]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(price_row, rows))


def _broadcast(columns: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return every column as a list of Python objects, all of the same length."""
    for name in REQUIRED_COLUMNS:
        if name not in columns:
            raise InvalidInputError(name, "missing", "given as a column or a scalar")
    allowed = (*OPTION_COLUMNS, *MARKET_COLUMNS, "tolerance")
    for name in columns:
        if name not in allowed:
            raise InvalidInputError("columns", name, "named " + ", ".join(allowed))
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    lengths = {array.size for array in arrays.values() if array.ndim == 1}
    if any(array.ndim > 1 for array in arrays.values()) or len(lengths) > 1:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InvalidInputError("columns", shapes, "scalars and vectors of one length")
    length = lengths.pop() if lengths else 1
    return {
        name: array.tolist() if array.ndim == 1 else [array.item()] * length for name, array in arrays.items()
    }


def _collect(results: list[Valuation | InvalidInputError | ArithmeticError]) -> dict[str, NDArray[Any]]:
    count = len(results)
    table: dict[str, NDArray[Any]] = {name: np.full(count, np.nan) for name in NUMBERS}
    table["exercise_now"] = np.zeros(count, dtype=bool)
    table |= {name: np.full(count, "", dtype=object) for name in TEXTS}
    for i, result in enumerate(results):
        if not isinstance(result, Valuation):
            invalid = isinstance(result, InvalidInputError)
            table["status"][i] = "invalid_input" if invalid else "out_of_domain"
            table["message"][i] = str(result)
            continue
        for name in NUMBERS:
            number = getattr(result, name)
            table[name][i] = np.nan if number is None else number
        table["exercise_now"][i] = result.exercise_now
        for name in TEXTS[:3]:
            table[name][i] = getattr(result, name)
    return table
