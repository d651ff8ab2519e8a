"""Years from a valuation to the last trading moment of an expiration."""

from __future__ import annotations

import datetime as dt
from typing import TypeAlias

from pricing_core.american.contracts.dates import year_fraction
from pricing_core.chains.cells import as_moment
from pricing_core.errors import InvalidInputError

Moment: TypeAlias = dt.date | dt.datetime

CLOSE = dt.time(16)  # local time of the market, on the last trading day
SATURDAY = 5  # as `date.weekday` has it: such an expiration trades last on the day before


def valuation_moment(value: object) -> Moment:
    """Return a date, or a date-time of the market's local time.

    Raises
    ------
    InvalidInputError
        It is neither, or has an offset from UTC.
    """
    moment = as_moment("valuation_date", value)
    if moment is None:
        raise InvalidInputError("valuation_date", value, "a date, or a date-time in local time of the market")
    return moment


def time_to_expiry(valuation: Moment, expiration: dt.date) -> float:
    """Return the years to an expiration; negative where it has passed.

    From a date without a time of day whole days are counted, divided by 365; from a date-time the seconds until
    16:00 of the last trading day, which for an expiration on a Saturday is the Friday before.

    Examples
    --------
    >>> saturday = dt.date(2014, 6, 21)
    >>> round(365 * time_to_expiry(dt.date(2014, 6, 6), saturday), 6)
    15.0
    >>> round(365 * time_to_expiry(dt.datetime(2014, 6, 6, 11), saturday), 6)
    14.208333
    """
    if not isinstance(valuation, dt.datetime):
        return year_fraction(valuation, expiration)
    last = expiration - dt.timedelta(days=1) if expiration.weekday() == SATURDAY else expiration
    return year_fraction(valuation, dt.datetime.combine(last, CLOSE))
