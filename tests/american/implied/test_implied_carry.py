import csv
import datetime as dt
import math
from decimal import Decimal
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest

from pricing_core.american import (
    CashDividend,
    PiecewiseConstant,
    implied_carry,
    implied_volatility_many,
    price_many,
)
from pricing_core.american.implied import implied_carry as module
from pricing_core.american.price_many import price_columns
from pricing_core.errors import InvalidInputError
from tests.problems.needs_kernel import needs_kernel

AAPL = Path(__file__).parents[4] / "shared" / "references" / "market" / "aapl_2014-06-06.csv"
needs_aapl = pytest.mark.skipif(not AAPL.exists(), reason="the quotes are not part of the project")
SPOT, RATE = 100.0, 0.05
YIELDS = {0.1: 0.0, 0.5: 0.03, 1.0: -0.01, 2.0: 0.08}  # the cost of borrowing is in them


def synthetic_chain(yields=YIELDS, strikes=(85.0, 90.0, 95.0, 100.0, 105.0, 110.0, 115.0), **shared):
    """Return the chain, without prices, and its prices, with a skew in the volatility."""
    rows = [(side, K, T) for T in yields for K in strikes for side in ("call", "put")]
    option_type, strike, expiry = (np.array(column) for column in zip(*rows, strict=True))
    chain = {
        "option_type": option_type,
        "strike": strike,
        "expiry": expiry,
        "spot": SPOT,
        "rate": RATE,
        **shared,
    }
    contracts = {
        **chain,
        "volatility": 0.25 - 0.2 * np.log(strike / SPOT),
        "dividend_yield": np.array([yields[T] for T in expiry.tolist()]),
    }
    return chain, price_many(contracts, tolerance=1e-7, greeks="none")["price"]


def errors_of_forward(carry, yields=YIELDS):
    expected = np.array([SPOT * math.exp((RATE - q) * T) for T, q in yields.items()])
    return np.abs(carry.forward - expected)


@needs_kernel
def test_the_yield_of_an_american_chain_is_recovered():
    chain, prices = synthetic_chain()
    carry = implied_carry({**chain, "option_price": prices})
    assert carry.status.tolist() == ["ok"] * 4
    assert carry.expiry.tolist() == list(YIELDS)
    assert np.max(errors_of_forward(carry)) <= 1e-3  # ten tolerances of the strike
    assert np.max(np.abs(carry.dividend_yield - list(YIELDS.values())) * carry.expiry) <= 1e-5
    assert np.max(carry.residual) <= 1e-3
    assert (carry.pairs_used >= 5).all()


@needs_kernel
@pytest.mark.parametrize("model", ["spot", "escrowed"])
def test_the_yield_of_a_chain_with_a_curve_of_rates_and_dividends_is_recovered(model):
    rate = PiecewiseConstant([0.25, 0.75, 2.0], [0.01, 0.08, -0.02])
    dividends = [CashDividend(0.2, 1.0), CashDividend(0.7, 2.0)]
    yields = {0.5: 0.02, 1.5: 0.0}
    shared = {"rate": rate, "cash_dividends": dividends, "dividend_model": model}
    chain, prices = synthetic_chain(yields, **shared)
    carry = implied_carry({**chain, "option_price": prices})
    assert carry.status.tolist() == ["ok"] * 2
    assert np.max(np.abs(carry.dividend_yield - list(yields.values())) * carry.expiry) <= 1e-5
    for place, (T, q) in enumerate(yields.items()):
        forward, last = SPOT, 0.0
        if model == "escrowed":
            due = math.fsum(
                d.amount * math.exp(-rate.integral(0.0, d.time)) for d in dividends if d.time <= T
            )
            forward = (SPOT - due) * math.exp(rate.integral(0.0, T) - q * T)
        else:
            for d in [*(d for d in dividends if d.time <= T), CashDividend(T, 0.0)]:
                forward = forward * math.exp(rate.integral(last, d.time) - q * (d.time - last)) - d.amount
                last = d.time
        assert carry.forward[place] == pytest.approx(forward, abs=1e-3)


@needs_kernel
def test_the_first_passes_are_coarse_and_the_yield_does_not_depend_on_that():
    dividends = [{"time": 0.2 + 0.25 * k, "amount": 0.5} for k in range(7)]
    chain, prices = synthetic_chain({0.5: 0.02, 2.0: 0.0}, cash_dividends=dividends)
    asked = []

    def priced(columns, settings, threads):
        asked.append(settings.tolerance)
        return price_columns(columns, settings, threads)

    with patch.object(module, "price_columns", priced):
        carry = implied_carry({**chain, "option_price": prices})
    assert asked.count(1e-6) == 2 < len(asked)  # once for each expiry
    assert np.max(np.abs(carry.dividend_yield - [0.02, 0.0]) * carry.expiry) <= 1e-5


@needs_kernel
def test_european_parity_on_american_prices_is_biased():
    chain, prices = synthetic_chain()
    naive = implied_carry({**chain, "option_price": prices, "exercise": "european"})
    wrong = np.abs(naive.dividend_yield - list(YIELDS.values()))
    assert wrong[0] > 1e-3
    assert wrong[3] > 5e-3
    assert errors_of_forward(naive)[3] > 1.0  # money, for a spot of 100


def test_parity_of_a_european_chain_is_exact():
    chain, prices = synthetic_chain(exercise="european")
    carry = implied_carry({**chain, "option_price": prices})
    assert np.max(np.abs(carry.dividend_yield - list(YIELDS.values()))) <= 1e-11
    assert np.max(carry.residual) <= 1e-11


@needs_kernel
def test_a_quote_far_off_is_left_out():
    chain, prices = synthetic_chain()
    bid, ask = prices - 0.01, prices + 0.01
    bid[6], ask[6] = bid[6] + 0.5, ask[6] + 0.5  # a call of the first expiry
    carry = implied_carry({**chain, "bid": bid, "ask": ask})
    assert carry.pairs_used.tolist() == [5, 7, 7, 7]  # one put of the first expiry has no bid
    assert np.max(errors_of_forward(carry)) <= 2e-3


@needs_kernel
def test_wide_quotes_count_for_less():
    rng = np.random.default_rng(5)
    chain, prices = synthetic_chain()
    half = np.where(np.arange(prices.size) % 14 < 6, 0.005, 0.3)
    noisy = prices + half * rng.uniform(-1.0, 1.0, prices.size)
    carry = implied_carry({**chain, "bid": np.maximum(noisy - half, 0.001), "ask": noisy + half})
    assert np.max(errors_of_forward(carry)) <= 0.02


@needs_kernel
@pytest.mark.parametrize(
    ("change", "statuses"),
    [
        ({"bid": 0.0}, ["no_pairs"] * 2),  # one-sided
        ({"ask": math.nan}, ["no_pairs"] * 2),
        ({"option_type": "put"}, ["no_pairs"] * 2),
        ({"spot": 1e4}, ["no_pairs"] * 2),  # no volatility explains the prices
        ({}, ["ok"] * 2),
    ],
)
def test_an_expiry_without_pairs_says_so(change, statuses):
    chain, prices = synthetic_chain({0.1: 0.0, 0.5: 0.03})
    carry = implied_carry({**chain, "bid": prices * 0.999, "ask": prices * 1.001, **change})
    assert carry.status.tolist() == statuses
    failed = carry.status != "ok"
    assert (carry.pairs_used[failed] == 0).all()
    for column in (carry.forward, carry.dividend_yield, carry.residual):
        assert np.isnan(column[failed]).all()
        assert np.isfinite(column[~failed]).all()


def test_a_yield_that_no_market_has_does_not_converge():
    chain = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 0.01, "spot": 100.0, "rate": 0.0}
    carry = implied_carry({**chain, "option_price": [12.0, 1.0]})
    assert carry.status.tolist() == ["no_convergence"]
    assert np.isnan(carry.dividend_yield[0])


@needs_kernel
def test_of_several_quotes_of_one_option_the_narrowest_counts():
    chain, prices = synthetic_chain({0.5: 0.03})
    doubled = {
        name: np.append(column, column) if np.ndim(column) else column for name, column in chain.items()
    }
    bid = np.append(prices - 1e-4, 0.5 * prices)
    ask = np.append(prices + 1e-4, 2.0 * prices)
    carry = implied_carry({**doubled, "bid": bid, "ask": ask})
    assert carry.dividend_yield[0] == pytest.approx(0.03, abs=1e-4)


def test_an_empty_chain_has_no_expiries():
    carry = implied_carry(
        {"option_type": [], "strike": [], "expiry": [], "option_price": [], "spot": 100.0, "rate": 0.0}
    )
    assert carry.forward.shape == carry.status.shape == (0,)


@pytest.mark.parametrize(
    "change",
    [
        {"spot": 0.0},
        {"rate": {"times": [1.0, 2.0], "values": [0.1, 20.0]}},
        {"exercise": "bermudan"},
        {"option_price": 1.0, "bid": 1.0},
        {"volatility": 0.2},
        {"strike": [90.0, 100.0, 110.0]},
        {"cash_dividends": [{"time": 0.1}]},
    ],
)
def test_a_chain_as_a_whole_can_be_refused(change):
    chain = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 1.0, "spot": 100.0, "rate": 0.05}
    with pytest.raises(InvalidInputError):
        implied_carry({**chain, "option_price": [10.0, 6.0], **change})


DIVIDENDS = [{"time": 0.2, "amount": 1.0}, {"time": 0.7, "amount": 1.0}]


def forward_with_dividends(dividend_yield, expiry):
    due = (d["amount"] * math.exp((RATE - dividend_yield) * (expiry - d["time"])) for d in DIVIDENDS)
    return SPOT * math.exp((RATE - dividend_yield) * expiry) - math.fsum(due)


def test_parity_with_cash_dividends_takes_them_off_the_forward():
    chain = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 1.0, "spot": SPOT, "rate": RATE}
    forward = forward_with_dividends(0.02, 1.0)
    call = 9.0
    put = call - (forward - 100.0) * math.exp(-RATE)
    quotes = {"option_price": [call, put], "exercise": "european", "cash_dividends": DIVIDENDS}
    carry = implied_carry({**chain, **quotes})
    assert carry.dividend_yield[0] == pytest.approx(0.02, abs=1e-12)
    assert carry.forward[0] == pytest.approx(forward, abs=1e-12)


@needs_kernel
def test_the_yield_on_top_of_cash_dividends_is_recovered():
    yields = {1.0: 0.02}
    chain, prices = synthetic_chain(yields, strikes=(95.0, 105.0), cash_dividends=DIVIDENDS)
    carry = implied_carry({**chain, "option_price": prices}, tolerance=1e-5)
    assert carry.status.tolist() == ["ok"]
    assert carry.forward[0] == pytest.approx(forward_with_dividends(0.02, 1.0), abs=1e-2)
    assert carry.dividend_yield[0] == pytest.approx(0.02, abs=1e-4)
    naive = implied_carry({**chain, "option_price": prices, "exercise": "european"})
    assert abs(naive.dividend_yield[0] - 0.02) > 1e-3


def read_aapl():
    """Return the chain of 6 June 2014, 11:00, an option's life ending at 16:00 on its last trading day."""
    with AAPL.open(newline="") as file:
        rows = list(csv.DictReader(file))
    now = dt.datetime(2014, 6, 6, 11)

    def years(clearing):
        day = dt.date.fromisoformat(clearing)
        day -= dt.timedelta(days=1) if day.weekday() == 5 else dt.timedelta()
        return (dt.datetime.combine(day, dt.time(16)) - now) / dt.timedelta(days=365)

    return {
        "option_type": np.array([row["option_type"] for row in rows]),
        **{name: np.array([float(row[name]) for row in rows]) for name in ("strike", "bid", "ask")},
        "expiry": np.array([years(row["expiration"]) for row in rows]),
        "spot": float(rows[0]["underlying_price"]),
        "rate": 0.0053,
    }


def share_identified(chain, contracts, tolerance):
    """Return how many two-sided quotes outside the exercise region have a volatility at mid, and their share.

    Outside the exercise region: the mid is more than the intrinsic value, to a cent. Others are in the region or
    below it, where there is no volatility to be found.
    """
    bid, ask, spot = chain["bid"], chain["ask"], chain["spot"]
    sign = np.where(chain["option_type"] == "put", 1.0, -1.0)
    intrinsic = np.maximum(sign * (chain["strike"] - spot), 0.0)
    outside = (bid > 0.0) & (ask > bid) & (0.5 * (bid + ask) >= intrinsic + 0.01)
    columns = {
        name: column[outside] if isinstance(column, np.ndarray) else column
        for name, column in {**chain, **contracts}.items()
        if name not in ("bid", "ask")
    }
    table = implied_volatility_many(columns, 0.5 * (bid + ask)[outside], tolerance=tolerance)
    ok = table["status"] == "ok"
    missed = np.abs(table["price"] - 0.5 * (bid + ask)[outside])[ok]
    assert np.max(missed / columns["strike"][ok]) <= tolerance
    return outside.sum(), ok.mean()


@needs_kernel
@needs_aapl
def test_the_quotes_of_a_real_chain_have_implied_volatilities():
    chain = read_aapl()
    carry = implied_carry(chain)
    assert carry.expiry.size == 13
    assert (carry.status == "ok").all()
    assert (carry.pairs_used >= 4).all()
    assert np.max(carry.residual) < 0.2  # dollars, of 647
    assert np.max(np.abs(carry.forward / chain["spot"] - 1.0)) < 0.03
    row_yield = carry.dividend_yield[np.searchsorted(carry.expiry, chain["expiry"])]
    count, share = share_identified(chain, {"dividend_yield": row_yield}, 1e-6)
    assert count > 2000
    assert share >= 0.95


def listed_dividends():
    """Return what a fit from outside found: 3.29 dollars a quarter."""
    dates = ["2014-08-07", "2014-11-06", "2015-02-05", "2015-05-07", "2015-08-06", "2015-11-05"]
    now = dt.datetime(2014, 6, 6, 11)
    years = [(dt.datetime.fromisoformat(date) - now) / dt.timedelta(days=365) for date in dates]
    return [{"time": time, "amount": 3.29} for time in years]


@needs_kernel
@needs_aapl
def test_american_parity_of_a_real_chain_finds_its_dividends_and_european_parity_does_not():
    chain = {**read_aapl(), "cash_dividends": listed_dividends()}
    carry = implied_carry(chain, tolerance=1e-5)
    assert (carry.status == "ok").all()
    later = carry.expiry > 0.1  # before, a cent is a large yield
    assert np.max(np.abs(carry.dividend_yield[later])) < 0.002  # nothing is left to explain
    naive = implied_carry({**chain, "exercise": "european"})
    august = np.argmax(carry.expiry > 0.15)  # just after the first ex-date
    assert carry.forward[august] == pytest.approx(644.87, abs=0.1)
    assert naive.forward[august] - carry.forward[august] > 0.8  # dollars, of the dividend of 3.29


@needs_aapl
@pytest.mark.nightly
def test_the_quotes_of_a_real_chain_have_implied_volatilities_with_cash_dividends():
    count, share = share_identified(read_aapl(), {"cash_dividends": listed_dividends()}, 1e-5)
    assert count > 2000
    assert share >= 0.95


def test_a_pair_whose_first_guess_is_exact_tells_its_yield():
    contracts = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 0.5, "spot": 100.0, "rate": 0.05}
    prices = price_many({**contracts, "dividend_yield": 0.05, "volatility": 0.2}, tolerance=1e-8)["price"]
    carry = implied_carry(
        {**contracts, "option_price": prices}
    )  # r = q: parity holds for American options too
    assert carry.status.tolist() == ["ok"]
    assert carry.dividend_yield[0] == pytest.approx(0.05, abs=1e-7)


@pytest.mark.parametrize(
    "given",
    [
        np.float64,
        np.array,
        lambda spot: np.array([spot, spot]),
        lambda spot: pd.Series([spot, spot]),
        Decimal,
    ],
    ids=["number of NumPy", "array without axes", "array", "series", "decimal"],
)
def test_what_all_rows_share_may_be_a_column_or_a_number_of_any_kind(given):
    chain = {"option_type": ["call", "put"], "strike": 100.0, "expiry": 1.0, "spot": 100.0, "rate": 0.05}
    chain |= {"option_price": price_many({**chain, "volatility": 0.2, "dividend_yield": 0.03})["price"]}
    wanted = implied_carry(chain)
    found = implied_carry({**chain, "spot": given(100.0), "rate": given(0.05)})
    assert found.dividend_yield.tolist() == wanted.dividend_yield.tolist()


def test_what_all_rows_share_must_be_the_same_in_all_of_them():
    chain = {
        "option_type": ["call", "put"],
        "strike": 100.0,
        "expiry": 1.0,
        "rate": 0.05,
        "option_price": 6.0,
    }
    with pytest.raises(InvalidInputError, match="spot = different values: must be the same in every row"):
        implied_carry({**chain, "spot": np.array([100.0, 101.0])})
