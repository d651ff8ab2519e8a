"""Greeks per year and per 1.00 of a parameter, or per day and per 0.01 of it."""

from collections.abc import Iterable, Mapping
from typing import Any

from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.fields import GREEKS_UNITS, GreeksUnits

DEFAULT_UNITS: GreeksUnits = GREEKS_UNITS.default
POINT = 0.01
# What a Greek is multiplied by to be one per day and per point; the others have no such unit.
PER_DAY_PER_POINT: Mapping[str, float] = {
    "theta": 1.0 / DAYS_PER_YEAR,
    "charm": 1.0 / DAYS_PER_YEAR,
    **dict.fromkeys(("vega", "rho", "dividend_rho", "vanna"), POINT),
    "volga": POINT * POINT,
    **dict.fromkeys(("rate_buckets", "dividend_yield_buckets", "volatility_buckets"), POINT),
}


def factor(name: str, units: GreeksUnits) -> float:
    """Return the factor from the library's unit of an output to the unit asked for.

    Examples
    --------
    >>> factor("vega_error", "per_day_per_point"), factor("delta", "per_day_per_point")
    (0.01, 1.0)
    """
    return 1.0 if units == DEFAULT_UNITS else PER_DAY_PER_POINT.get(name.removesuffix("_error"), 1.0)


def in_units(found: Mapping[str, Any], units: GreeksUnits) -> dict[str, Any]:
    """Return outputs by name, numbers and lists of numbers, in the units asked for, which are named."""
    if units == DEFAULT_UNITS:
        return {**found, "greeks_units": units}
    changed = {name: _times(value, factor(name, units)) for name, value in found.items()}
    return {**changed, "greeks_units": units}


def _times(value: Any, by: float) -> Any:
    if by == 1.0 or value is None:
        return value
    if isinstance(value, Iterable):
        return [_times(entry, by) for entry in value]
    return by * value
