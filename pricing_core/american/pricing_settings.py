"""What a table of contracts is priced with."""

from dataclasses import dataclass

from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, GREEKS, TOLERANCE, Greeks
from pricing_core.american.method import Method, engines_of


@dataclass(frozen=True, slots=True)
class PricingSettings:
    """What holds for every row; meanings as in `price_many`.

    Parameters
    ----------
    tolerance : float
        For rows that state none.
    greeks : {"none", "standard", "extended"}
    greek_errors : bool
    share_solves : bool
    method : {"auto", "lcs", "crank-nicolson"}

    Raises
    ------
    InvalidInputError
        One of them is not what it must be.
    """

    tolerance: float = DEFAULT_TOLERANCE
    greeks: Greeks = "standard"
    greek_errors: bool = False
    share_solves: bool = False
    method: Method = "auto"

    def __post_init__(self) -> None:
        TOLERANCE.check(self.tolerance)
        GREEKS.check_choice(self.greeks)
        check_kind("greek_errors", self.greek_errors, bool, "True or False")
        check_kind("share_solves", self.share_solves, bool, "True or False")
        engines_of(self.method)
