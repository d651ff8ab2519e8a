"""The market the option is valued in: flat rate, yield and volatility."""

from dataclasses import dataclass

from pricing_core.american.contract import LARGEST_MONEY, real_number

SMALLEST_RATE, LARGEST_RATE = -0.5, 2.0  # 1/year, for rate and dividend_yield
NEGLIGIBLE_RATE = 1e-30  # 1/year; what is less counts as zero, for its ratios would overflow
LARGEST_VOLATILITY = 15.0  # 1/sqrt(year)


@dataclass(frozen=True, slots=True)
class Market:
    """Spot, continuously compounded rate and yield, and the volatility of ln(spot).

    Parameters
    ----------
    spot : float
        Money per unit of underlying, 0 to 1e30.
    rate, dividend_yield : float
        1/year, continuously compounded, -0.5 to 2; the cost of borrowing the stock adds to the yield.
    volatility : float
        1/sqrt(year), 0 to 15.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.
    """

    spot: float
    rate: float
    volatility: float
    dividend_yield: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "spot", real_number("spot", self.spot, 0.0, LARGEST_MONEY))
        for name in ("rate", "dividend_yield"):
            rate = real_number(name, getattr(self, name), SMALLEST_RATE, LARGEST_RATE)
            object.__setattr__(self, name, rate if abs(rate) >= NEGLIGIBLE_RATE else 0.0)
        object.__setattr__(
            self, "volatility", real_number("volatility", self.volatility, 0.0, LARGEST_VOLATILITY)
        )
