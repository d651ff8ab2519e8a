"""The market the option is valued in: spot, rate, yield, volatility and dividends."""

from __future__ import annotations

from dataclasses import dataclass

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, read_curve
from pricing_core.american.contracts.dividends import (
    CashDividend,
    ProportionalDividend,
    read_cash_dividends,
    read_proportional_dividends,
)
from pricing_core.american.contracts.fields import (
    DIVIDEND_MODEL,
    DIVIDEND_YIELD,
    RATE,
    SPOT,
    VOLATILITY,
    DividendModel,
)

# Largest rate or yield that counts as zero, in 1/year: ratios of smaller ones would overflow.
NEGLIGIBLE_RATE = 1e-30


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
        object.__setattr__(self, "spot", SPOT.check(self.spot))
        for field in (RATE, DIVIDEND_YIELD):
            rate = read_curve(field, getattr(self, field.name))
            negligible = isinstance(rate, float) and abs(rate) < NEGLIGIBLE_RATE
            object.__setattr__(self, field.name, 0.0 if negligible else rate)
        object.__setattr__(self, "volatility", read_curve(VOLATILITY, self.volatility))
        if type(self.cash_dividends) is not tuple or self.cash_dividends:
            object.__setattr__(self, "cash_dividends", read_cash_dividends(self.cash_dividends))
        if type(self.proportional_dividends) is not tuple or self.proportional_dividends:
            read = read_proportional_dividends(self.proportional_dividends)
            object.__setattr__(self, "proportional_dividends", read)
        DIVIDEND_MODEL.check_choice(self.dividend_model)

    def has_curves(self) -> bool:
        """Whether the rate, the yield or the volatility changes with time."""
        return any(
            isinstance(curve, PiecewiseConstant)
            for curve in (self.rate, self.dividend_yield, self.volatility)
        )
