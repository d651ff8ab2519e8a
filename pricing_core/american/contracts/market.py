"""The market the option is valued in: spot, rate, yield, volatility and dividends."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from pricing_core.american.contracts.contract import LARGEST_MONEY, real_number
from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, read_curve
from pricing_core.american.contracts.dividends import (
    CashDividend,
    ProportionalDividend,
    read_cash_dividends,
    read_proportional_dividends,
)
from pricing_core.errors import InvalidInputError

DividendModel: TypeAlias = Literal["spot", "escrowed"]
DIVIDEND_MODELS = ("spot", "escrowed")
SMALLEST_RATE, LARGEST_RATE = -0.5, 2.0  # 1/year, for rate and dividend_yield
NEGLIGIBLE_RATE = 1e-30  # 1/year; what is less counts as zero, for its ratios would overflow
LARGEST_VOLATILITY = 15.0  # 1/sqrt(year)


@dataclass(frozen=True, slots=True)
class FlatMarket:
    """A market whose rate, yield and volatility do not change before expiry, without dividends at known times.

    Units and limits are those of `Market`; nothing is checked.
    """

    spot: float
    rate: float
    volatility: float
    dividend_yield: float = 0.0


@dataclass(frozen=True, slots=True)
class Market:
    """Spot, continuously compounded rate and yield, the volatility of ln(spot), and dividends at known times.

    Parameters
    ----------
    spot : float
        Money per unit of underlying, 0 to 1e30.
    rate, dividend_yield : float or PiecewiseConstant
        1/year, continuously compounded, -0.5 to 2; the cost of borrowing the stock adds to the yield.
    volatility : float or PiecewiseConstant
        1/sqrt(year), 0 to 15.
    cash_dividends : sequence of CashDividend or {"time": ..., "amount": ...}
        Kept in the order of their times.
    proportional_dividends : sequence of ProportionalDividend or {"time": ..., "fraction": ...}
        Kept in the order of their times; on one date they come before the cash dividends.
    dividend_model : {"spot", "escrowed"}
        "spot": the spot drops by each amount, and is lognormal in between. "escrowed": the spot less the present
        value of the cash dividends due by expiry is lognormal.

    Curves may also be given as {"times": [...], "values": [...]}.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.
    """

    spot: float
    rate: Curve
    volatility: Curve
    dividend_yield: Curve = 0.0
    cash_dividends: tuple[CashDividend, ...] = ()
    proportional_dividends: tuple[ProportionalDividend, ...] = ()
    dividend_model: DividendModel = "spot"

    def __post_init__(self) -> None:
        object.__setattr__(self, "spot", real_number("spot", self.spot, 0.0, LARGEST_MONEY))
        for name in ("rate", "dividend_yield"):
            rate = read_curve(name, getattr(self, name), SMALLEST_RATE, LARGEST_RATE)
            negligible = isinstance(rate, float) and abs(rate) < NEGLIGIBLE_RATE
            object.__setattr__(self, name, 0.0 if negligible else rate)
        object.__setattr__(
            self, "volatility", read_curve("volatility", self.volatility, 0.0, LARGEST_VOLATILITY)
        )
        if type(self.cash_dividends) is not tuple or self.cash_dividends:
            object.__setattr__(self, "cash_dividends", read_cash_dividends(self.cash_dividends))
        if type(self.proportional_dividends) is not tuple or self.proportional_dividends:
            read = read_proportional_dividends(self.proportional_dividends)
            object.__setattr__(self, "proportional_dividends", read)
        if self.dividend_model not in DIVIDEND_MODELS:
            raise InvalidInputError("dividend_model", self.dividend_model, '"spot" or "escrowed"')

    def flat_until(self, expiry: float) -> FlatMarket | None:
        """Return the same market without curves and dividends; None where there are some before expiry."""
        numbers = []
        for curve in (self.rate, self.volatility, self.dividend_yield):
            if isinstance(curve, PiecewiseConstant) and curve.knots(0.0, expiry):
                return None
            numbers.append(curve.at(0.0) if isinstance(curve, PiecewiseConstant) else curve)
        if any(d.amount > 0.0 and 0.0 < d.time <= expiry for d in self.cash_dividends) or any(
            d.fraction > 0.0 and 0.0 < d.time <= expiry for d in self.proportional_dividends
        ):
            return None
        return FlatMarket(self.spot, *numbers)
