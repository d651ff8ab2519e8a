"""Option symbols of the Options Clearing Corporation: root, expiration, side, strike times 1000."""

from __future__ import annotations

import datetime as dt
import re
from dataclasses import dataclass

from pricing_core.errors import InvalidInputError

SYMBOL = re.compile(r"(?:O:)?([A-Z0-9.$^/]{1,6}?) *(\d{6})([CP])(\d{8})", re.ASCII)


@dataclass(frozen=True, slots=True)
class OccSymbol:
    """What the symbol of a listed option says.

    Parameters
    ----------
    root : str
        Symbol of the underlying; with a digit at its end where the deliverable was adjusted.
    expiration : date
    option_type : {"call", "put"}
    strike : float
        Money.
    """

    root: str
    expiration: dt.date
    option_type: str
    strike: float

    @property
    def is_adjusted(self) -> bool:
        """Whether the contract delivers something else than its multiplier of shares."""
        return self.root[-1].isdigit()


def read_occ_symbol(text: str) -> OccSymbol:
    """Return what a symbol says; blanks in it may be missing, and it may begin with "O:".

    Raises
    ------
    InvalidInputError
        It is no such symbol, or its date is none.

    Examples
    --------
    >>> found = read_occ_symbol("AAPL  140719C00650000")
    >>> found.root, found.expiration.isoformat(), found.option_type, found.strike
    ('AAPL', '2014-07-19', 'call', 650.0)
    """
    found = SYMBOL.fullmatch(text.strip())
    if found is None:
        raise InvalidInputError("contract_symbol", text, "an OCC symbol such as AAPL  140719C00650000")
    root, day, side, strike = found.groups()
    try:
        expiration = dt.datetime.strptime(day, "%y%m%d").date()
    except ValueError:
        raise InvalidInputError(
            "contract_symbol", text, "an OCC symbol with a date in it as YYMMDD"
        ) from None
    return OccSymbol(root, expiration, "call" if side == "C" else "put", int(strike) / 1000.0)
