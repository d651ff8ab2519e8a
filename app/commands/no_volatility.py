"""Why a price has no implied volatility, in words and with the bound that it lies beyond."""

from pricing_core.american import Market, Option
from pricing_core.american.contracts.fields import VOLATILITY
from pricing_core.american.implied.volatility_bounds import price_bounds


def why_no_volatility(status: str, option: Option, market: Market, observed: float) -> str:
    """Return a status of `implied_volatility` with its meaning for this contract.

    Parameters
    ----------
    observed : float
        The price that was to be explained, money.

    Examples
    --------
    >>> market = Market(spot=100.0, rate=0.05, volatility=0.2)
    >>> why_no_volatility("above_upper_bound", Option("put", 100.0, 1.0), market, 200.0)
    'above_upper_bound: 200 must be below 100: no volatility makes the option worth that'
    """
    lower, upper = price_bounds(option, market)
    reasons = {
        "below_lower_bound": f"{observed:.10g} must be at least {lower:.10g}, what the option is worth at volatility 0",
        "above_upper_bound": f"{observed:.10g} must be below {upper:.10g}: no volatility makes the option worth that"
        if observed >= upper
        else f"{observed:.10g} is more than the option is worth at volatility {VOLATILITY.most:g}, the largest",
        "not_identifiable": f"the option is worth {lower:.10g} at volatility 0, and at a whole interval of them",
    }
    return f"{status}: {reasons[status]}" if status in reasons else status
