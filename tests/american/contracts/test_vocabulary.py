"""One flat mapping makes the option and the market, wherever it comes from."""

import datetime as dt
import math

import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, ProportionalDividend
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.vocabulary import NAMES, OPTIONAL, contract_from
from pricing_core.errors import InvalidInputError

PLAIN = {"option_type": "put", "spot": 100.0, "strike": 90.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
UNDATED = {name: value for name, value in PLAIN.items() if name != "expiry"}
DATED = {**UNDATED, "valuation_date": "2026-01-01", "expiration_date": "2027-01-01"}
CURVE = PiecewiseConstant([0.5, 1.0], [0.1, 0.2])


def refused(contract):
    with pytest.raises(InvalidInputError) as caught:
        contract_from(contract)
    return caught.value


def test_plain_values_are_those_of_the_constructors():
    assert contract_from(PLAIN) == (Option("put", 90.0, 1.0), Market(100.0, 0.05, 0.2))


def test_every_name_reaches_its_field():
    contract = {
        **PLAIN,
        "exercise": "bermudan",
        "exercise_times": [0.5, 0.25],
        "rate": {"times": [0.5, 1.0], "values": [0.1, 0.2]},
        "dividend_yield": CURVE,
        "volatility": '{"times": [0.5, 1.0], "values": [0.1, 0.2]}',
        "cash_dividends": [{"time": 0.5, "amount": 1.0}, CashDividend(0.25, 2.0)],
        "proportional_dividends": '[{"time": 0.5, "fraction": 0.01}]',
        "dividend_model": "escrowed",
    }
    assert contract_from(contract) == (
        Option("put", 90.0, 1.0, "bermudan", (0.25, 0.5)),
        Market(
            100.0,
            CURVE,
            CURVE,
            CURVE,
            (CashDividend(0.25, 2.0), CashDividend(0.5, 1.0)),
            (ProportionalDividend(0.5, 0.01),),
            "escrowed",
        ),
    )
    assert contract_from({**PLAIN, "exercise_start": 0.5})[0] == Option("put", 90.0, 1.0, exercise_start=0.5)


@pytest.mark.parametrize("missing", [None, math.nan, "", "  ", np.datetime64("NaT")], ids=repr)
def test_an_optional_value_that_is_missing_is_as_good_as_absent(missing):
    absent = {name: missing for name in OPTIONAL if name != "expiry"}
    assert contract_from({**PLAIN, **absent}) == contract_from(PLAIN)
    assert contract_from({**DATED, "expiry": missing}) == contract_from(DATED) == contract_from(PLAIN)


@pytest.mark.parametrize("times", [[0.5, 0.25], (0.5, 0.25), np.array([0.5, 0.25]), "[0.5, 0.25]"])
def test_a_list_may_be_any_sequence_or_its_text(times):
    option, _ = contract_from({**PLAIN, "exercise": "bermudan", "exercise_times": times})
    assert option.exercise_times == (0.25, 0.5)


def test_ex_dates_are_times_from_the_valuation_date():
    dividends = [
        {"ex_date": "2026-03-15", "amount": 1.0},
        {"ex_date": "2026-01-01", "amount": 2.0, "time": None},
        {"ex_date": "2027-01-01", "amount": 3.0},
        {"time": 0.5, "amount": 4.0, "ex_date": None},
    ]
    _, market = contract_from({**DATED, "cash_dividends": dividends})
    assert [(dividend.time, dividend.amount) for dividend in market.cash_dividends] == [
        (0.0, 2.0),
        (0.2, 1.0),
        (0.5, 4.0),
        (1.0, 3.0),
    ]


@pytest.mark.parametrize(
    "times",
    [
        ["2026-03-15", "2027-01-01"],
        ["2026-03-15T00:00", 1.0],
        [dt.date(2026, 3, 15), dt.datetime(2027, 1, 1)],
        np.array(["2026-03-15", "2027-01-01"], "M8[ns]"),
        '["2026-03-15", 1]',
    ],
    ids=repr,
)
def test_exercise_times_may_be_dates(times):
    option, _ = contract_from({**DATED, "exercise": "bermudan", "exercise_times": times})
    assert option.exercise_times == (0.2, 1.0)


@pytest.mark.parametrize(
    "start", ["2026-03-15", dt.date(2026, 3, 15), np.datetime64("2026-03-15", "ns"), 0.2]
)
def test_an_exercise_window_may_start_on_a_date(start):
    assert contract_from({**DATED, "exercise_start": start})[0].exercise_start == 0.2


def test_a_window_that_has_started_is_open_now():
    assert contract_from({**DATED, "exercise_start": "2025-06-01"})[0] == contract_from(DATED)[0]


def test_a_dividend_before_the_valuation_has_gone_already():
    dated = {**DATED, "valuation_date": "2026-01-01T10:00", "expiration_date": "2027-01-01T10:00"}
    for ex_date in ("2026-01-01", "1999-01-01"):
        _, market = contract_from(
            {**dated, "proportional_dividends": [{"ex_date": ex_date, "fraction": 0.1}]}
        )
        assert market.proportional_dividends == (ProportionalDividend(0.0, 0.1),)


def test_a_dividend_of_the_far_future_is_after_expiry_and_no_fault():
    _, market = contract_from({**DATED, "cash_dividends": [{"ex_date": "9999-01-01", "amount": 1.0}]})
    assert Book.of([(Option("put", 100.0, 1.0), market)]).is_simple


@pytest.mark.parametrize(
    "date", ["2027-01-15", dt.date(2027, 1, 15), dt.datetime(2027, 1, 15), np.datetime64("2027-01-15")]
)
def test_a_date_as_expiry_is_told_how_dates_are_given(date):
    told = "a number from 0 to 200, in years; or valuation_date and expiration_date in its place"
    assert refused({**PLAIN, "expiry": date}).allowed == told
    with pytest.raises(InvalidInputError, match=told):
        Option("put", 90.0, date)


@pytest.mark.parametrize(
    ("contract", "message"),
    [
        (
            {**PLAIN, "vol": 0.2},
            "a contract has no field 'vol': did you mean volatility?",
        ),
        (UNDATED, "expiry is missing: give it, or valuation_date and expiration_date"),
        ({**DATED, "expiry": 1.0}, "expiry = 1.0: must be left out where dates are given"),
        ({**UNDATED, "valuation_date": "2026-01-01"}, "expiration_date is missing: valuation_date needs it"),
        ({**UNDATED, "expiration_date": "2026-01-01"}, "valuation_date is missing: expiration_date needs it"),
        ({**PLAIN, "valuation_date": "2026-01-01"}, "expiry = 1.0: must be left out where dates are given"),
        ({**PLAIN, "rate": "5%"}, "rate = '5%': must be a number or {"),
        ({**PLAIN, "rate": "3"}, "rate = 3: must be a number from -0.5 to 2"),
        ({**PLAIN, "rate": '{"times": [1]'}, "rate = '{\"times\": [1]': must be a number or {"),
        (
            {**PLAIN, "rate": {"times": [1.0], "values": [3.0]}},
            "rate.values = 3.0: must be a number from -0.5 to 2",
        ),
        ({**PLAIN, "volatility": {"values": [0.2]}}, "volatility = {'values': [0.2]}: must be a number or {"),
        ({**PLAIN, "cash_dividends": "[1"}, "cash_dividends = '[1': must be a list of"),
        ({**PLAIN, "cash_dividends": "[NaN]"}, "it holds NaN or Infinity"),
        (
            {**PLAIN, "cash_dividends": '{"time": 1}'},
            "cash_dividends = '{\"time\": 1}': must be a list of {",
        ),
        (
            {**PLAIN, "cash_dividends": [0.5]},
            'cash_dividends[0] = 0.5: must be {"time": ..., "amount": ...}, (time, amount) or',
        ),
        (
            {**PLAIN, "cash_dividends": [{"time": 0.25}]},
            "cash_dividends[0].amount is missing",
        ),
        (
            {**PLAIN, "proportional_dividends": [{"fraction": 0.25}]},
            "proportional_dividends[0].time is missing: give it, or ex_date where there is a valuation_date",
        ),
        (
            {**PLAIN, "cash_dividends": [{"time": 0.25, "amount": 1.0, "fraction": 0.1}]},
            "cash_dividends[0] has no key 'fraction': choose from time, ex_date and amount",
        ),
        (
            {**PLAIN, "cash_dividends": [{"time": 1, "amount": 1}, {"time": 1, "amount": -1.0}]},
            "cash_dividends[1].amount = -1.0: must be a number from 0 to 1e+30",
        ),
        (
            {**PLAIN, "cash_dividends": [{"ex_date": "2026-05-01", "amount": 1.0}]},
            "cash_dividends[0].ex_date = '2026-05-01': must be a number of years from now; a date where there is a",
        ),
        (
            {**DATED, "cash_dividends": [{"ex_date": "2026-05-01", "time": 1.0, "amount": 1.0}]},
            "cash_dividends[0].ex_date = '2026-05-01': must be left out where time is given",
        ),
        (
            {**DATED, "proportional_dividends": [{"ex_date": "May", "fraction": 1.0}]},
            "proportional_dividends[0].ex_date = 'May': must be an ISO date",
        ),
        (
            {**DATED, "cash_dividends": [{"ex_date": "2026-05-01T00:00Z", "amount": 1.0}]},
            "must be given without a UTC offset, as the other dates are",
        ),
        (
            {**PLAIN, "exercise": "bermudan", "exercise_times": [0.5, "2026-05-01"]},
            "exercise_times[1] = '2026-05-01': must be a number of years from now; a date where there is a",
        ),
        (
            {**DATED, "exercise": "bermudan", "exercise_times": ["2026-01-01"]},
            "exercise_times[0] = '2026-01-01': must be after valuation_date, and not after expiration_date",
        ),
        (
            {**DATED, "exercise": "bermudan", "exercise_times": ["2026-13-01"]},
            "exercise_times[0] = '2026-13-01': must be an ISO date or date-time such as",
        ),
        (
            {**DATED, "exercise_start": "2027-01-02"},
            "exercise_start = '2027-01-02': must be a date that is not after expiration_date",
        ),
        ({**PLAIN, "exercise_times": "0.5"}, "exercise_times = 0.5: must be a list of times"),
        (
            {**PLAIN, "dividend_model": "forward"},
            'dividend_model = \'forward\': must be "spot" or "escrowed"',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_does_not_make_a_contract_is_named_with_what_is_allowed(contract, message):
    assert message in str(refused(contract))


@pytest.mark.parametrize("name", [name for name in NAMES if name in PLAIN])
def test_a_required_name_that_is_missing_is_told(name):
    assert refused({key: value for key, value in PLAIN.items() if key != name}).field == name


@pytest.mark.parametrize("contract", [None, [], "put", 7])
def test_a_contract_is_a_mapping(contract):
    assert refused(contract).allowed == "a mapping of names to values"
