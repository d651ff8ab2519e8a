"""What a table of contracts is priced with."""

from dataclasses import dataclass

from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, GREEKS, TOLERANCE, Greeks


@dataclass(frozen=True, slots=True)
class PricingSettings:
    """What holds for every row.

    Parameters
    ----------
    tolerance : float
        Fraction of the strike, for rows that state none.
    greeks : {"none", "standard", "extended"}
        As in `price_many`, and the next two.
    greek_errors : bool
    share_solves : bool

    Raises
    ------
    InvalidInputError
        The tolerance or greeks is not what it must be.
    """

    tolerance: float = DEFAULT_TOLERANCE
    greeks: Greeks = "standard"
    greek_errors: bool = False
    share_solves: bool = False

    def __post_init__(self) -> None:
        TOLERANCE.check(self.tolerance)
        GREEKS.check_choice(self.greeks)
