import datetime as dt

import pytest

from pricing_core.chains.side_files import read_dividends, read_rates
from pricing_core.errors import InvalidInputError


def written(tmp_path, text, name="side.csv"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_zero_rates_become_forward_rates_with_the_same_discounts(tmp_path):
    curve = read_rates(written(tmp_path, "time,rate\n0.5,0.02\n1,0.03\n2,0.035\n"))
    for time, zero in ((0.5, 0.02), (1.0, 0.03), (2.0, 0.035)):
        assert curve.integral(0.0, time) == pytest.approx(zero * time, abs=1e-15)


def test_days_count_as_days_of_365(tmp_path):
    assert read_rates(written(tmp_path, "days,rate\n73,0.01\n")).times == (0.2,)


def test_the_zero_curve_of_optionmetrics_is_in_percent_and_its_last_date_counts(tmp_path):
    text = "date,days,rate\n20260227,365,9.0\n20260302,365,4.0\n"
    assert read_rates(written(tmp_path, text), "optionmetrics").values == (0.04,)


def test_a_curve_in_json_is_taken_as_it_is(tmp_path):
    curve = read_rates(written(tmp_path, '{"times": [1, 2], "values": [0.01, 0.02]}', "rates.json"))
    assert (curve.times, curve.values) == ((1.0, 2.0), (0.01, 0.02))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("time,rate\n1,4.0\n", "looks like percent"),
        ("time,rate\n1,0.04\n0.5,0.04\n", "increasing"),
        ("time,yield\n1,0.04\n", "column rate"),
        ("rate\n0.04\n", "column time"),
        ("time,rate\n", "at least one rate"),
        ("time,rate\n1,\n", "row 1"),
        ("time;rate\n1;0,04\n", "commas"),
    ],
)
def test_rates_that_cannot_be_read_say_why(tmp_path, text, told):
    with pytest.raises(InvalidInputError, match=told):
        read_rates(written(tmp_path, text))


def test_dividends_have_dates_or_times(tmp_path):
    dated = read_dividends(written(tmp_path, "Ex-Date,Amount\n2026-05-08,0.9\n20260807,0.95\n"))
    assert dated == [
        {"ex_date": dt.date(2026, 5, 8), "amount": 0.9},
        {"ex_date": dt.date(2026, 8, 7), "amount": 0.95},
    ]
    assert read_dividends(written(tmp_path, "time,amount\n0.25,1\n")) == [{"time": 0.25, "amount": 1.0}]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("day,amount\n1,1\n", "ex_date or time"),
        ("ex_date,amount\n,1\n", "missing"),
        ("ex_date,amount\nx,1\n", "a date"),
    ],
)
def test_dividends_that_cannot_be_read_say_why(tmp_path, text, told):
    with pytest.raises(InvalidInputError, match=told):
        read_dividends(written(tmp_path, text))
