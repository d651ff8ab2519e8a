"""Arguments that are not known or missing are named as every other wrong input is."""

import pickle
from dataclasses import replace
from inspect import signature

import pytest

from pricing_core.american import CashDividend, Market, Option
from pricing_core.errors import InvalidInputError


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Market(spot=100.0, rate=0.05, volatility=0.2, div_yield=0.01),
            "Market has no argument 'div_yield': did you mean dividend_yield?",
        ),
        (lambda: Market(100.0, 0.05, vol=0.2), "Market has no argument 'vol': did you mean volatility?"),
        (
            lambda: Option("put", 100.0, maturity=1.0),
            "Option has no argument 'maturity': choose from option_type, strike, expiry, exercise",
        ),
        (
            lambda: replace(Market(100.0, 0.05, 0.2), sopt=90.0),
            "Market has no argument 'sopt': did you mean spot?",
        ),
        (
            lambda: CashDividend(0.5, value=1.0),
            "CashDividend has no argument 'value': choose from time and amount",
        ),
        (lambda: Market(100.0, rate=0.05), "volatility is missing"),
        (lambda: Option("put"), "strike is missing"),
        (Option, "option_type and strike are missing"),
        (lambda: Option("put", 100.0), "expiry is missing: give it, or valuation_date and expiration_date"),
    ],
)
def test_arguments_that_are_not_known_or_missing_are_named(make, message):
    with pytest.raises(InvalidInputError) as caught:
        make()
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    "make",
    [lambda: Option("put", 100.0, 1.0, strike=90.0), lambda: CashDividend(0.5, 1.0, 2.0)],
)
def test_other_wrong_calls_are_the_errors_of_python(make):
    with pytest.raises(TypeError, match="argument"):
        make()


def test_records_whose_arguments_are_named_have_their_signature_and_are_pickled():
    market = Market(100.0, 0.05, 0.2)
    assert pickle.loads(pickle.dumps(market)) == market
    assert list(signature(Market).parameters)[:3] == ["spot", "rate", "volatility"]


@pytest.mark.parametrize(
    ("dividends", "message"),
    [
        (1.0, "cash_dividends = 1.0: must be a list of {"),
        (
            {"time": 0.5, "amount": 1.0},
            "cash_dividends = {'time': 0.5, 'amount': 1.0}: must be a list of {",
        ),
        (
            CashDividend(0.5, 1.0),
            "cash_dividends = CashDividend(time=0.5, amount=1.0): must be a list of {",
        ),
        ([(0.5, 1.0, 2.0)], "cash_dividends[0] = (0.5, 1.0, 2.0): must be {"),
        (
            [{"time": 0.5, "value": 1.0}],
            "cash_dividends[0] has no key 'value': choose from time, ex_date and amount",
        ),
    ],
)
def test_dividends_of_another_shape_are_told_their_shape(dividends, message):
    with pytest.raises(InvalidInputError) as caught:
        Market(100.0, 0.05, 0.2, cash_dividends=dividends)
    assert str(caught.value).startswith(message)
