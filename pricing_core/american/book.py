"""A table of contracts as arrays, one option per row, each row checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contract import (
    LARGEST_EXPIRY,
    LARGEST_MONEY,
    SMALLEST_MONEY,
    Option,
    check_kind,
    real_number,
)
from pricing_core.american.market import (
    LARGEST_RATE,
    LARGEST_VOLATILITY,
    NEGLIGIBLE_RATE,
    SMALLEST_RATE,
    Market,
)
from pricing_core.american.tolerances import LARGEST_TOLERANCE, SMALLEST_TOLERANCE, check_moneyness
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

REQUIRED_COLUMNS = ("option_type", "spot", "strike", "expiry", "rate", "volatility")
DEFAULTS: Mapping[str, object] = {"exercise": "american", "dividend_yield": 0.0}
LIMITS = {
    "spot": (0.0, LARGEST_MONEY),
    "strike": (SMALLEST_MONEY, LARGEST_MONEY),
    "expiry": (0.0, LARGEST_EXPIRY),
    "rate": (SMALLEST_RATE, LARGEST_RATE),
    "dividend_yield": (SMALLEST_RATE, LARGEST_RATE),
    "volatility": (0.0, LARGEST_VOLATILITY),
    "tolerance": (SMALLEST_TOLERANCE, LARGEST_TOLERANCE),
}


@dataclass(frozen=True, slots=True, eq=False)
class Book:
    """Options and the markets they are valued in; every array has shape (n,). Units as in `Option` and `Market`.

    Parameters
    ----------
    is_put, is_american : bool array
    spot, strike, expiry, rate, dividend_yield, volatility : Vector
    tolerance : Vector
        Fractions of the strike.
    """

    is_put: BoolVector
    is_american: BoolVector
    spot: Vector
    strike: Vector
    expiry: Vector
    rate: Vector
    dividend_yield: Vector
    volatility: Vector
    tolerance: Vector

    def take(self, rows: NDArray[np.intp]) -> "Book":
        """Return some of the rows."""
        return Book(*(getattr(self, name)[rows] for name in self.__slots__))

    def slice(self, rows: slice) -> "Book":
        """Return consecutive rows, without copying them."""
        return Book(*(getattr(self, name)[rows] for name in self.__slots__))

    def option(self, row: int) -> Option:
        """Return the contract of one row."""
        return Option(
            "put" if self.is_put[row] else "call",
            self.strike.item(row),
            self.expiry.item(row),
            "american" if self.is_american[row] else "european",
        )

    def market(self, row: int) -> Market:
        """Return the market of one row."""
        numbers = (self.spot, self.rate, self.volatility, self.dividend_yield)
        return Market(*(column.item(row) for column in numbers))


def single_row(option: Option, market: Market, tolerance: float) -> Book:
    """Return the book of one contract."""
    numbers = (
        market.spot,
        option.strike,
        option.expiry,
        market.rate,
        market.dividend_yield,
        market.volatility,
        tolerance,
    )
    return Book(
        np.array([option.is_put]),
        np.array([option.exercise == "american"]),
        *np.array(numbers).reshape(-1, 1),
    )


def read_book(columns: Mapping[str, Any], tolerance: float) -> tuple[Book, dict[int, InvalidInputError]]:
    """Return the book, and by row the reason why its contract is refused; such a row holds NaN.

    Parameters
    ----------
    columns : mapping of str to array_like, shape (n,), or scalar
    tolerance : float
        For rows without one of their own.

    Raises
    ------
    InvalidInputError
        A column is missing or unknown, or lengths differ.
    """
    check_kind("columns", columns, Mapping, "a mapping of names to columns")
    table = _broadcast({**DEFAULTS, "tolerance": tolerance, **columns})
    numbers = {name: _as_numbers(table[name]) for name in LIMITS}
    types, exercises = table["option_type"], table["exercise"]
    is_put, is_american = types == "put", exercises == "american"
    sound = (is_put | (types == "call")) & (is_american | (exercises == "european"))
    with np.errstate(all="ignore"):
        for name, (least, most) in LIMITS.items():
            sound &= (numbers[name] >= least) & (numbers[name] <= most)
        ratio = numbers["spot"] / numbers["strike"]
    unusual = np.flatnonzero(~(sound & ((ratio == 0.0) | ((ratio >= 1e-29) & (ratio <= 1e29)))))
    reasons = {}
    for row in unusual.tolist():
        fault = _fault({name: column[row] for name, column in table.items()})
        if fault is not None:
            reasons[row] = fault
            for column in numbers.values():
                column[row] = np.nan
    for name in ("rate", "dividend_yield"):
        numbers[name][np.abs(numbers[name]) < NEGLIGIBLE_RATE] = 0.0
    return Book(is_put=is_put, is_american=is_american, **numbers), reasons


def _broadcast(columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return every column as an array, all of the same length."""
    for name in REQUIRED_COLUMNS:
        if name not in columns:
            raise InvalidInputError(name, "missing", "given as a column or a scalar")
    allowed = ("option_type", "exercise", *LIMITS)
    for name in columns:
        if name not in allowed:
            raise InvalidInputError("columns", name, "named " + ", ".join(allowed))
    arrays = {name: _as_array(name, values) for name, values in columns.items()}
    lengths = {array.size for array in arrays.values() if array.ndim == 1}
    if any(array.ndim > 1 for array in arrays.values()) or len(lengths) > 1:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InvalidInputError("columns", shapes, "scalars and vectors of one length")
    length = lengths.pop() if lengths else 1
    return {name: np.broadcast_to(array, (length,)) for name, array in arrays.items()}


def _as_array(name: str, values: object) -> NDArray[Any]:
    """Return a column as an array; masked cells become None, which no field takes."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            return np.asarray(np.ma.filled(values.astype(object), None))
        array = np.asarray(values)
        if array.ndim == 1 and isinstance(values, list | tuple) and _is_mixed(values, array.dtype.kind):
            array = np.empty(len(values), dtype=object)
            array[:] = values
        return array
    except ValueError:
        raise InvalidInputError(name, type(values).__name__, "a scalar or a vector") from None


def _is_mixed(cells: Sequence[object], kind: str) -> bool:
    """Whether NumPy has turned truth values into numbers, or numbers into texts."""
    if kind in "fiu":
        return any(isinstance(cell, bool | np.bool_) for cell in cells)
    return kind in "US" and not all(isinstance(cell, str) for cell in cells)


def _as_numbers(column: NDArray[Any]) -> Vector:
    """Return a copy as floats, NaN for what is no number."""
    if column.dtype.kind in "fiu":
        return column.astype(np.float64)
    if column.dtype.kind in "mM":  # durations and dates, whose items may be plain integers
        return np.full(column.shape, np.nan)
    return np.array([_number_or_nan(cell) for cell in column.tolist()], dtype=np.float64)


def _number_or_nan(cell: object) -> float:
    if type(cell) is float:
        return cell
    try:
        return real_number("", cell)
    except InvalidInputError:
        return float("nan")


def _fault(row: Mapping[str, Any]) -> InvalidInputError | None:
    """Return what is wrong with a row, in the words of the single contract; None if nothing."""
    row = {name: _plain(cell) for name, cell in row.items()}
    try:
        option = Option(row["option_type"], row["strike"], row["expiry"], row["exercise"])
        market = Market(row["spot"], row["rate"], row["volatility"], row["dividend_yield"])
        real_number("tolerance", row["tolerance"], SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
        check_moneyness(option, market)
    except InvalidInputError as fault:
        return fault
    return None


def _plain(cell: object) -> object:
    """Return NumPy's numbers and texts as Python's; not its durations, whose item may be a plain integer."""
    return cell.item() if isinstance(cell, np.generic) and cell.dtype.kind in "fiuU" else cell
