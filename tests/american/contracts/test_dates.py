"""Dates: years by the second, and every date that is none refused by its name."""

import datetime as dt
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from pricing_core.american.contracts.dates import expiry_from_dates, year_fraction
from pricing_core.errors import InvalidInputError

DAY = 1.0 / 365.0


@pytest.mark.parametrize(
    ("start", "end", "days"),
    [
        ("2026-01-01", "2026-01-02", 1.0),
        ("2024-01-01", "2025-01-01", 366.0),  # a leap year is longer than 1
        ("2026-03-01", "2026-02-28", -1.0),
        ("2026-01-01T00:00", "2026-01-01T18:00", 0.75),
        ("2026-01-01 09:30:00", "2026-01-02", 14.5 / 24.0),
        ("2026-01-01T12:00:00.500", "2026-01-01T12:00:01", 0.5 / 86_400.0),
        ("2026-01-01T12:00Z", "2026-01-01T12:00-06:00", 0.25),
        (dt.date(2026, 1, 1), dt.datetime(2026, 1, 1, 12), 0.5),
        (np.datetime64("2026-01-01"), np.datetime64("2026-01-03T00", "ns"), 2.0),
    ],
)
def test_a_year_has_365_days_of_86400_seconds(start, end, days):
    assert year_fraction(start, end) == pytest.approx(days * DAY, abs=1e-15)


def test_hours_are_those_that_pass_and_not_those_of_the_clock_on_the_wall():
    zone = ZoneInfo("America/New_York")
    before, after = dt.datetime(2026, 3, 8, tzinfo=zone), dt.datetime(2026, 3, 9, tzinfo=zone)
    assert year_fraction(before, after) == pytest.approx(DAY * 23.0 / 24.0, abs=1e-15)


@pytest.mark.parametrize(
    ("start", "end"), [("2026-01-01T00:00Z", "2026-01-02"), ("2026-01-01", "2026-01-02T00:00+01:00")]
)
def test_one_date_with_an_offset_and_one_without_are_refused(start, end):
    with pytest.raises(InvalidInputError, match=r"^end = '2026-01-02.*: must be given with.* a UTC offset"):
        year_fraction(start, end)


@pytest.mark.parametrize(
    "date",
    [
        "",
        "2026",
        "2026-1-1",
        "20260101",
        "2026-W01-1",
        "2026-02-30",
        "2026-01-01T25:00",
        "2026-01-01T12",
        "2026-01-01\n",
        "01/02/2026",
        "\uff12026-01-01",
        20260101,
        1.0,
        True,
        None,
        np.datetime64("NaT"),
        dt.time(12),
        dt.datetime(1, 1, 1, tzinfo=dt.timezone(dt.timedelta(hours=12))),
    ],
    ids=repr,
)
def test_what_is_no_date_is_refused_by_name(date):
    with pytest.raises(InvalidInputError, match="must be an ISO date or date-time such as") as caught:
        expiry_from_dates("2026-01-01", date)
    assert caught.value.field == "expiration_date"
    with pytest.raises(InvalidInputError) as caught:
        expiry_from_dates(date, "2026-01-01")
    assert caught.value.field == "valuation_date"


@pytest.mark.parametrize("expiration", ["2025-12-31", "2025-12-31T23:59:59", "2226-01-01"])
def test_an_expiration_before_the_valuation_or_after_200_years_is_refused(expiration):
    with pytest.raises(InvalidInputError, match="at most 200 years after valuation_date, and not before it"):
        expiry_from_dates("2026-01-01", expiration)


def test_an_option_may_expire_at_once_or_after_200_years():
    assert expiry_from_dates("2026-01-01", "2026-01-01") == 0.0
    assert expiry_from_dates("2026-01-01", "2225-11-14") == 200.0
