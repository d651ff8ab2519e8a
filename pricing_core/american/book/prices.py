"""What the engines say of contracts: the one type that carries a price from them to every reader."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, TypeAlias, get_type_hints

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.ragged import Ragged
from pricing_core.arrays import BoolVector, Vector

Status: TypeAlias = Literal["ok", "tolerance_not_met", "invalid_input", "out_of_domain", "deadline"]


@dataclass(frozen=True, slots=True, eq=False)
class Prices:
    """Prices of n contracts with their derivatives; money per unit of underlying, NaN where there is nothing.

    Parameters
    ----------
    value, european, error : Vector, shape (n,)
        The price, the price without early exercise, and the estimated absolute error of the price.
    delta, gamma, theta, vega, rho, dividend_rho, vanna, volga, charm, delta_sticky_moneyness : Vector, shape (n,)
        As in `Valuation`.
    boundary : Vector, shape (n,)
        The exercise boundary now; where there are two, the one nearer the strike.
    boundary_error : Vector, shape (n,)
        The estimated absolute error of the boundary; NaN where there is no boundary, or no estimate.
    dividend_sensitivities, rate_buckets, dividend_yield_buckets, volatility_buckets : Ragged
        One number for each entry that the contract lists (`Listed`), or none at all.
    delta_error, ..., charm_error, dividend_sensitivities_error, ... : Vector, shape (n,), or Ragged
        The estimated absolute error of each of these Greeks; NaN, or no list, where there is no estimate.
    exercised : bool array, shape (n,)
        Whether the spot lies in the exercise region, and exercise pays.
    settled : bool array, shape (n,)
        Whether the engine stands by the row; otherwise the next engine is asked as well.
    complete : bool array, shape (n,)
        Whether every Greek that was asked for is there.
    status, method, message : object array of str, shape (n,)
        The status is "ok" until the row has been compared with its tolerance, unless the engine ended it.
    solves, steps : int array, shape (n,)
        How often the contract was solved, and the time steps of the finest solve.
    residual : Vector, shape (n,)
        Largest natural residual of the finest solve's complementarity problems, as a fraction of the strike.
    fitted : bool array, shape (n,)
        Whether the drift dominated the diffusion on the finest grid, which makes the solve first order.
    resolution : object array of (Resolution or None), shape (n,)
        The grid and the steps of the finest solve.
    """

    value: Vector
    european: Vector
    error: Vector
    delta: Vector
    gamma: Vector
    theta: Vector
    vega: Vector
    rho: Vector
    dividend_rho: Vector
    vanna: Vector
    volga: Vector
    charm: Vector
    delta_sticky_moneyness: Vector
    boundary: Vector
    boundary_error: Vector
    dividend_sensitivities: Ragged
    rate_buckets: Ragged
    dividend_yield_buckets: Ragged
    volatility_buckets: Ragged
    delta_error: Vector
    gamma_error: Vector
    theta_error: Vector
    vega_error: Vector
    rho_error: Vector
    dividend_rho_error: Vector
    vanna_error: Vector
    volga_error: Vector
    charm_error: Vector
    delta_sticky_moneyness_error: Vector
    dividend_sensitivities_error: Ragged
    rate_buckets_error: Ragged
    dividend_yield_buckets_error: Ragged
    volatility_buckets_error: Ragged
    exercised: BoolVector
    settled: BoolVector
    complete: BoolVector
    status: NDArray[np.object_]
    method: NDArray[np.object_]
    message: NDArray[np.object_]
    solves: NDArray[np.int64]
    steps: NDArray[np.int64]
    residual: Vector
    fitted: BoolVector
    resolution: NDArray[np.object_]

    @property
    def count(self) -> int:
        """The number of contracts n."""
        return self.value.size

    def take(self, rows: NDArray[np.intp]) -> Prices:
        """Return some of the rows, in the order asked for."""
        return Prices(*(taken(getattr(self, name), rows) for name in self.__slots__))

    def replaced(self, rows: NDArray[np.intp], found: Prices) -> Prices:
        """Return these prices with some rows taken, in their order, from others."""
        if rows.size == 0:
            return self
        if rows.size == self.count:
            return found if bool((rows[:-1] < rows[1:]).all()) else found.take(np.argsort(rows))
        return Prices(
            *(_replaced(getattr(self, name), rows, getattr(found, name)) for name in self.__slots__)
        )


_TYPES = get_type_hints(Prices)
NUMBERS = tuple(name for name, kind in _TYPES.items() if kind == Vector and name != "residual")
LISTS = tuple(name for name, kind in _TYPES.items() if kind == Ragged)
FLAGS = ("exercised", "settled", "complete", "fitted")
TEXTS = ("method", "message")
CACHED = 8192  # Number of rows of the shared columns of one value: those of one chunk.
COUNTS = ("solves", "steps")
COLUMN = (np.ndarray, Ragged)
# The Greeks that are one number for each contract, and those that are lists.
GREEKS = (
    *("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "volga", "charm"),
    "delta_sticky_moneyness",
)
GREEK_LISTS = (
    "dividend_sensitivities",
    *(f"{name}_buckets" for name in ("rate", "dividend_yield", "volatility")),
)


def error_of(greek: str) -> str:
    """Return the name of the column with the error estimate of a Greek."""
    return f"{greek}_error"


# What each column holds where there is nothing, and its type.
_KINDS: dict[str, tuple[Any, type]] = {
    **dict.fromkeys(NUMBERS, (math.nan, np.float64)),
    **dict.fromkeys(FLAGS, (False, np.bool_)),
    **dict.fromkeys(TEXTS, ("", np.object_)),
    "status": ("ok", np.object_),
    **dict.fromkeys(COUNTS, (0, np.int64)),
    "residual": (0.0, np.float64),
    "resolution": (None, np.object_),
}


def prices(count: int, **columns: Any) -> Prices:
    """Return prices with these columns; the others hold nothing.

    Parameters
    ----------
    columns
        Columns of `Prices` by name; a number, a flag or a text serves all rows.
    """
    nothing = _shared_nothing(count) if count <= CACHED else _nothing(count)
    for name, column in columns.items():
        if not isinstance(column, COLUMN):
            columns[name] = constant(column, count, _KINDS[name][1])
    return Prices(**(nothing | columns))


def constant(value: Any, count: int, kind: type = np.object_) -> NDArray[Any]:
    """Return a column of one value; up to CACHED rows it is a view of one that all prices share."""
    return np.full(count, value, dtype=kind) if count > CACHED else _cached(value, kind)[:count]


def _nothing(count: int) -> dict[str, Any]:
    """Return the columns of prices that hold nothing."""
    columns: dict[str, Any] = {name: constant(kind[0], count, kind[1]) for name, kind in _KINDS.items()}
    return columns | dict.fromkeys(LISTS, Ragged.empty(count))


_shared_nothing = lru_cache(maxsize=8)(_nothing)


@lru_cache(maxsize=64)
def _cached(value: Any, kind: type) -> NDArray[Any]:
    column: NDArray[Any] = np.full(CACHED, value, dtype=kind)
    column.flags.writeable = False
    return column


def concatenated(parts: Sequence[Prices]) -> Prices:
    """Return the rows of several `Prices` in one, in their order."""
    if len(parts) == 1:
        return parts[0]
    columns: dict[str, Any] = {}
    for name in Prices.__slots__:
        pieces = [getattr(part, name) for part in parts]
        if name in LISTS:
            columns[name] = Ragged.concatenated(pieces)
        else:
            columns[name] = np.concatenate(pieces)
    return Prices(**columns)


def taken(column: Any, rows: NDArray[np.intp]) -> Any:
    """Return some rows of a column, an array or a `Ragged`."""
    return column.take(rows) if isinstance(column, Ragged) else column[rows]


def _replaced(column: Any, rows: NDArray[np.intp], found: Any) -> Any:
    if isinstance(column, Ragged):
        return column.replaced(rows, found)
    changed = column.copy()
    changed[rows] = found
    return changed
