import datetime as dt

import pytest

from pricing_core.chains.expiry_time import time_to_expiry, valuation_moment
from pricing_core.errors import InvalidInputError

NOON = dt.datetime(2014, 6, 6, 12)


@pytest.mark.parametrize(
    ("valuation", "expiration", "days"),
    [
        (dt.date(2014, 6, 6), dt.date(2014, 6, 6), 0.0),
        (dt.date(2014, 6, 6), dt.date(2014, 6, 21), 15.0),  # whole days between the dates as given
        (NOON, dt.date(2014, 6, 6), 4.0 / 24.0),
        (NOON, dt.date(2014, 6, 20), 14.0 + 4.0 / 24.0),
        (NOON, dt.date(2014, 6, 21), 14.0 + 4.0 / 24.0),  # a Saturday
        (dt.datetime(2014, 6, 6, 17), dt.date(2014, 6, 6), -1.0 / 24.0),
    ],
)
def test_years_are_whole_days_or_seconds_to_the_close(valuation, expiration, days):
    assert time_to_expiry(valuation, expiration) == pytest.approx(days / 365.0, abs=1e-15)


@pytest.mark.parametrize("value", ["yesterday", None, "2014-06-06T11:00Z", 12.5])
def test_what_is_no_local_moment_is_refused(value):
    with pytest.raises(InvalidInputError, match="valuation_date"):
        valuation_moment(value)
