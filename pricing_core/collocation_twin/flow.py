"""How ln(spot) moves between two events, in units of the strike and of years."""

from typing import NamedTuple


class Flow(NamedTuple):
    """Rate, yield and volatility of one stretch of time."""

    rate: float
    dividend: float
    volatility: float

    @property
    def drift(self) -> float:
        """Of ln(spot), per year."""
        return self.rate - self.dividend - 0.5 * self.volatility**2
