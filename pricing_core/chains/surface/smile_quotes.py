"""What a surface is fitted to: the volatilities of an expiry, and the American quotes of a chain in columns."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True, eq=False)
class SmileQuotes:
    """The European-equivalent volatilities of one expiry.

    Parameters
    ----------
    expiry : float
        Years.
    forward : float
        Money.
    log_moneyness : Vector, shape (n,)
        ln(strike/forward), increasing.
    strike : Vector, shape (n,)
        Money.
    volatility : Vector, shape (n,)
        1/sqrt(year), at mid.
    deviation : Vector, shape (n,)
        Standard deviation of the volatility: half the width of bid to ask, in volatility.
    forward_error : float
        Standard error of ln(forward), in what is reported of the fit; 0 where the forward is certain.
    by_forward : Vector, shape (n,), optional
        What a volatility changes by with ln(forward), the price of the quote being what it is; 0 by default.

    A quote of which a number is missing (NaN) or a deviation is not above 0 is left out of a fit.

    Raises
    ------
    InvalidInputError
        The columns differ in length.
    """

    expiry: float
    forward: float
    log_moneyness: Vector
    strike: Vector
    volatility: Vector
    deviation: Vector
    forward_error: float = 0.0
    by_forward: Vector | None = None

    def __post_init__(self) -> None:
        if self.by_forward is None:
            object.__setattr__(self, "by_forward", np.zeros(np.shape(self.deviation)))
        _read_columns(self, ("log_moneyness", "strike", "volatility", "deviation", "by_forward"))

    @property
    def usable(self) -> BoolVector:
        """Which quotes a fit can use, shape (n,)."""
        sound = (self.volatility > 0.0) & (self.deviation > 0.0) & (self.strike > 0.0)
        finite = np.isfinite(self.log_moneyness) & np.isfinite(self.volatility) & np.isfinite(self.deviation)
        found: BoolVector = sound & finite & np.isfinite(self.strike)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class AmericanQuotes:
    """American quotes of one underlying in columns, each of shape (n,).

    Parameters
    ----------
    option_type : array of str
        "put" or "call".
    strike, expiry : Vector
        Money, years.
    bid, ask, mid : Vector
        Money per unit of underlying. A quote with a missing number, or whose ask is not above its bid, counts neither
        for the surface nor for the shares within bid and ask.

    Raises
    ------
    InvalidInputError
        The columns differ in length, or an option type is another word.
    """

    option_type: NDArray[np.str_]
    strike: Vector
    expiry: Vector
    bid: Vector
    ask: Vector
    mid: Vector

    def __post_init__(self) -> None:
        types = np.asarray(self.option_type, dtype=np.str_)
        wrong = ~np.isin(types, ("put", "call"))
        if wrong.any():
            at = int(np.argmax(wrong))
            raise InvalidInputError(f"option_type[{at}]", str(types[at]), '"put" or "call"')
        object.__setattr__(self, "option_type", types)
        _read_columns(self, ("strike", "expiry", "bid", "ask", "mid"))
        if types.shape != self.strike.shape:
            raise InvalidInputError("option_type", f"shape {types.shape}", "as many as there are strikes")

    @property
    def is_call(self) -> BoolVector:
        """Whether each quote is that of a call, shape (n,)."""
        found: BoolVector = self.option_type == "call"
        return found

    @property
    def usable(self) -> BoolVector:
        """Whether each quote is complete and has a bid and an ask, shape (n,)."""
        numbers = (self.strike, self.expiry, self.bid, self.ask, self.mid)
        whole = np.all([np.isfinite(column) for column in numbers], axis=0)
        found: BoolVector = whole & (self.ask > self.bid) & (self.strike > 0.0) & (self.expiry > 0.0)
        return found

    def take(self, rows: NDArray[np.intp] | BoolVector) -> AmericanQuotes:
        """Return some of the quotes."""
        return AmericanQuotes(*(getattr(self, field.name)[rows] for field in fields(self)))


def _read_columns(table: object, names: tuple[str, ...]) -> None:
    """Make read-only vectors of the columns, which must be of one length."""
    first = None
    for name in names:
        column = np.array(getattr(table, name), dtype=np.float64)
        if column.ndim != 1 or (first is not None and column.shape != first):
            raise InvalidInputError(name, f"shape {column.shape}", "a vector as long as the other columns")
        first = column.shape
        column.flags.writeable = False
        object.__setattr__(table, name, column)
