"""What a table of contracts is priced with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, GREEKS, TOLERANCE, Greeks
from pricing_core.american.method import Method, engines_of
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class PricingSettings:
    """The settings with which every row of a table is priced; meanings as in `price_many`.

    Parameters
    ----------
    tolerance : float
        For rows that state none.
    greeks : {"none", "standard", "extended"}
    greek_errors : bool
    share_solves : bool
    method : {"auto", "lcs", "crank-nicolson"}
    deadline : float or array_like, shape (n,), optional
        Seconds for each row.
    advice : bool

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
    deadline: ArrayLike | None = None
    advice: bool = False

    def __post_init__(self) -> None:
        TOLERANCE.check(self.tolerance)
        object.__setattr__(self, "greeks", GREEKS.check_choice(self.greeks))
        check_kind("greek_errors", self.greek_errors, bool, "True or False")
        check_kind("share_solves", self.share_solves, bool, "True or False")
        check_kind("advice", self.advice, bool, "True or False")
        engines_of(self.method)
        if self.deadline is not None:
            self.deadlines(np.size(self.deadline))

    def deadlines(self, count: int) -> Vector | None:
        """Return the seconds that each of `count` rows may take, shape (count,); None where there is no limit.

        Raises
        ------
        InvalidInputError
            They are not one number >= 0, or one for each row.
        """
        if self.deadline is None:
            return None
        try:
            seconds = np.broadcast_to(np.asarray(self.deadline, dtype=np.float64), (count,))
        except (TypeError, ValueError):
            raise InvalidInputError(
                "deadline", self.deadline, "seconds, one number or one for each row"
            ) from None
        for number in seconds[~(seconds >= 0.0)][:1].tolist():
            raise InvalidInputError("deadline", number, "a number >= 0 (seconds)")
        return seconds
