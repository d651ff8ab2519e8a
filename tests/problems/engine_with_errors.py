"""An engine that knows the errors of some Greeks and not of others, for what carries them to the user."""

import numpy as np

from pricing_core.american.book.book import CURVES
from pricing_core.american.book.prices import GREEKS, error_of, prices
from pricing_core.american.book.ragged import Ragged

# Every Greek is known; these have an error estimate. Of the lists, each entry has the same.
ERRORS = {name: 1e-6 * (k + 1) for k, name in enumerate(GREEKS) if name not in ("gamma", "volga")}
LIST_ERRORS = {"dividend_sensitivities": 2e-5, "volatility_buckets": 3e-5}
EXTENDED = ("vanna", "volga", "charm", "rate_buckets", "dividend_yield_buckets", "volatility_buckets")


class EngineWithErrors:
    """Gives every contract a price of 6 and Greeks of 0.5, with the errors above."""

    name = "with errors"
    least_error = 0.0

    def serves(self, book):
        """Tell that the engine serves every contract."""
        return np.ones(book.count, dtype=bool)

    def solve(self, book, request):
        """Return the same numbers for every contract."""
        left_out = EXTENDED if request.greeks == "standard" else ()
        numbers = dict.fromkeys(GREEKS, 0.5) | {error_of(name): error for name, error in ERRORS.items()}
        lists = {"dividend_sensitivities": book.listed.cash_dividends}
        lists |= {f"{name}_buckets": getattr(book.listed, name) for name in CURVES}
        columns = {name: Ragged(times.first, 0.5 + 0.0 * times.values) for name, times in lists.items()}
        for name, error in LIST_ERRORS.items():
            columns[error_of(name)] = Ragged(lists[name].first, error + 0.0 * lists[name].values)
        given = numbers | columns
        for name in left_out:
            given.pop(name)
            given.pop(error_of(name), None)
        known = {"settled": True, "complete": True, "method": "known"}
        return prices(book.count, value=6.0, european=5.0, error=1e-7, **known, **given)
