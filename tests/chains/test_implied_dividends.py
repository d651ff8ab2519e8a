"""Cash dividends of which the dates are known: the amounts that quotes imply."""

import datetime as dt

import numpy as np
import pytest

from pricing_core.american import price_many
from pricing_core.chains import fit_chain
from pricing_core.errors import InvalidInputError

DATE, SPOT, RATE, VOLATILITY = dt.date(2026, 3, 2), 100.0, 0.03, 0.25
EXPIRY_DAYS, EX_DAYS, AMOUNTS = (20, 60, 110, 200, 290), (45, 135, 225), (0.7, 0.8, 0.9)
STRIKES = np.arange(88.0, 113.0, 3.0)


def chain(noise: float, seed: int = 0) -> dict:
    """Return quotes of a flat volatility, whose spot pays three dividends and nothing else."""
    days = np.repeat(EXPIRY_DAYS, 2 * STRIKES.size)
    columns = {
        "option_type": np.tile(np.repeat(["call", "put"], STRIKES.size), len(EXPIRY_DAYS)),
        "strike": np.tile(STRIKES, 2 * len(EXPIRY_DAYS)),
    }
    paid = [{"time": day / 365.0, "amount": amount} for day, amount in zip(EX_DAYS, AMOUNTS, strict=True)]
    market = {"spot": SPOT, "rate": RATE, "volatility": VOLATILITY, "cash_dividends": paid}
    price = price_many({**columns, **market, "expiry": days / 365.0}, tolerance=1e-7, greeks="none")["price"]
    half = 0.01 + 0.003 * price
    mid = price + noise * half * np.random.default_rng(seed).standard_normal(price.size)
    return {
        **columns,
        "underlying_price": [SPOT] * price.size,
        "quote_date": [DATE] * price.size,
        "expiration": [DATE + dt.timedelta(days=int(day)) for day in days],
        "bid": mid - half,
        "ask": mid + half,
    }


def dated(amounts: tuple) -> list[dict]:
    days = [DATE + dt.timedelta(days=day) for day in EX_DAYS]
    return [{"ex_date": day, "amount": amount} for day, amount in zip(days, amounts, strict=True)]


def test_without_noise_the_amounts_are_found_and_no_yield_is_left():
    fit = fit_chain(chain(0.0), RATE, cash_dividends=dated((None, None, None)))
    np.testing.assert_allclose(fit.dividends["time"].to_numpy(), np.array(EX_DAYS) / 365.0, rtol=1e-12)
    np.testing.assert_allclose(fit.dividends["amount"].to_numpy(), AMOUNTS, rtol=0.0, atol=2e-3)
    np.testing.assert_allclose(fit.carry["dividend_yield"].to_numpy(), 0.0, atol=1e-4)
    assert [each.amount for each in fit.market.cash_dividends] == fit.dividends["amount"].to_pylist()


@pytest.mark.nightly
def test_with_noise_they_lie_within_three_standard_errors_beside_one_that_is_given():
    fit = fit_chain(chain(1.0, seed=4), RATE, cash_dividends=dated((None, 0.8, None)))
    error = fit.dividends["standard_error"].to_pylist()
    assert error[1] is None
    amount = fit.dividends["amount"].to_pylist()
    assert amount[1] == 0.8
    for place in (0, 2):
        assert 0.0 < error[place] < 0.2
        assert abs(amount[place] - AMOUNTS[place]) < 3.0 * error[place]


def test_a_dividend_behind_the_last_expiry_cannot_be_implied():
    late = [{"ex_date": DATE + dt.timedelta(days=400)}]
    with pytest.raises(InvalidInputError, match="cash_dividends = a dividend without an amount"):
        fit_chain(chain(0.0), RATE, cash_dividends=late)
