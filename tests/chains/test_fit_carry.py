import numpy as np
import pytest

from pricing_core.american import CashDividend, PiecewiseConstant, price_many
from pricing_core.american.implied.carry_pairs import read_chain as read_pairs
from pricing_core.american.implied.implied_carry import stock_value
from pricing_core.chains.fit_carry import fit_carry
from pricing_core.errors import NumericalError
from tests.chains.chain_problems import EXPIRIES, RATE, displaced_chain
from tests.problems.nightly import nightly

BASIS_POINT = 1e-4
TOLERANCE = 1e-6
SEED = 20_261_124


@pytest.fixture(scope="module")
def known():
    return displaced_chain()


def noisy(known, rng):
    return known.price + known.half_spread * rng.standard_normal(known.price.size)


def test_the_carry_of_a_smile_is_recovered_without_noise(known):
    carry = fit_carry(read_pairs(known.chain(known.price)), tolerance=TOLERANCE)
    assert carry.status.tolist() == ["ok"] * EXPIRIES.size
    np.testing.assert_allclose(carry.dividend_yield, RATE, rtol=0.0, atol=0.1 * BASIS_POINT)
    np.testing.assert_allclose(carry.forward, 100.0, rtol=0.0, atol=2e-3)
    assert np.abs(carry.pair_residual).max() < 5e-3  # premiums of one volatility for all spots, at two years


@pytest.mark.parametrize("size", [1.0, *nightly([0.5, 2.0])])
def test_the_errors_of_the_carry_are_what_noise_makes(known, size):
    rng = np.random.default_rng(SEED)
    off = []
    for _ in range(8):
        mid = known.price + size * known.half_spread * rng.standard_normal(known.price.size)
        carry = fit_carry(read_pairs(known.chain(mid)), tolerance=TOLERANCE)
        off.append((carry.dividend_yield - RATE) / carry.standard_error)
    assert np.mean(np.abs(off) < 2.0) >= 0.9
    assert np.sqrt(np.mean(np.square(off))) > 0.2  # not made wide


@pytest.mark.nightly
def test_yields_that_change_lie_within_two_standard_errors():
    times = np.array([7, 21, 35, 63, 126, 245, 365, 730]) / 365.0
    strikes = np.array([94.0, 96.0, 98.0, 99.0, 101.0, 102.0, 104.0, 106.0])
    columns = {
        "option_type": np.tile(np.repeat(["call", "put"], strikes.size), times.size),
        "strike": np.tile(strikes, 2 * times.size),
        "expiry": np.repeat(times, 2 * strikes.size),
    }
    rng = np.random.default_rng(SEED)
    off = []
    for _ in range(40):
        curve = PiecewiseConstant(tuple(times), tuple(0.02 + np.cumsum(rng.normal(0.0, 0.004, times.size))))
        market = {"spot": 100.0, "rate": 0.04}
        price = price_many({**columns, **market, "dividend_yield": curve, "volatility": 0.25}, greeks="none")[
            "price"
        ]
        half = 0.02 + 0.004 * price
        mid = price + half * rng.standard_normal(price.size)
        chain = {**columns, **market, "bid": mid - half, "ask": mid + half}
        carry = fit_carry(read_pairs(chain), tolerance=TOLERANCE)
        truth = np.array([curve.integral(0.0, time) / time for time in times.tolist()])
        off.append((carry.dividend_yield - truth) / carry.standard_error)
    assert np.mean(np.abs(off) < 2.0) >= 0.93
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.2


def test_a_yield_on_top_of_given_dividends_is_recovered_with_its_curve():
    times = np.array([0.1, 0.3, 0.6, 1.0])
    curve = PiecewiseConstant(tuple(times), (0.01, 0.02, 0.0, 0.015))
    dividends = [CashDividend(0.2, 1.0), CashDividend(0.7, 1.0)]
    strikes = np.array([90.0, 95.0, 98.0, 100.0, 102.0, 105.0, 110.0])
    columns = {
        "option_type": np.tile(np.repeat(["call", "put"], strikes.size), times.size),
        "strike": np.tile(strikes, 2 * times.size),
        "expiry": np.repeat(times, 2 * strikes.size),
    }
    market = {"spot": 100.0, "rate": 0.03, "cash_dividends": dividends}
    contracts = {**columns, **market, "dividend_yield": curve, "volatility": 0.3}
    price = price_many(contracts, tolerance=1e-7, greeks="none")["price"]
    chain = read_pairs({**columns, **market, "bid": price - 0.02, "ask": price + 0.02})
    carry = fit_carry(chain, tolerance=TOLERANCE)
    mean = [curve.integral(0.0, time) / time for time in times.tolist()]
    np.testing.assert_allclose(carry.dividend_yield, mean, rtol=0.0, atol=0.5 * BASIS_POINT)
    stock = [stock_value(chain.market, curve, time) * np.exp(0.03 * time) for time in times.tolist()]
    np.testing.assert_allclose(carry.forward, stock, rtol=1e-4)


def test_european_chains_need_no_engine(known):
    columns = {"option_type": known.option_type, "strike": known.strike, "expiry": known.expiry}
    flat = {**columns, "spot": 100.0, "rate": 0.05, "exercise": "european"}
    price = price_many({**flat, "dividend_yield": 0.02, "volatility": 0.3}, greeks="none")["price"]
    carry = fit_carry(read_pairs({**flat, "bid": price, "ask": price + 1e-9}), tolerance=TOLERANCE)
    np.testing.assert_allclose(carry.dividend_yield, 0.02, rtol=0.0, atol=1e-7)


def test_an_outlier_does_not_move_the_carry(known):
    mid = known.price.copy()
    near = np.flatnonzero((known.expiry == EXPIRIES[3]) & (np.abs(known.strike - 100.0) < 3.0))
    mid[near[0]] += 2.0
    carry = fit_carry(read_pairs(known.chain(mid)), tolerance=TOLERANCE)
    np.testing.assert_allclose(carry.dividend_yield, RATE, rtol=0.0, atol=BASIS_POINT)


def test_expiries_without_pairs_take_the_yield_of_the_others(known):
    chain = known.chain(known.price)
    alone = (known.expiry == EXPIRIES[2]) & (known.option_type == "put")
    chain["bid"] = np.where(alone, np.nan, chain["bid"])
    carry = fit_carry(read_pairs(chain), tolerance=TOLERANCE)
    assert carry.status[2] == "no_pairs"
    assert np.isnan(carry.standard_error[2])
    np.testing.assert_allclose(carry.dividend_yield, RATE, rtol=0.0, atol=BASIS_POINT)


def test_one_sided_chains_have_no_carry(known):
    calls = {
        name: column[known.option_type == "call"]
        for name, column in known.chain(known.price).items()
        if isinstance(column, np.ndarray)
    }
    carry = fit_carry(read_pairs({**calls, "spot": 100.0, "rate": RATE}), tolerance=TOLERANCE)
    assert not carry.is_known
    assert carry.dividend_yield.tolist() == [0.0] * EXPIRIES.size


def test_a_single_strike_tells_the_carry(known):
    rows = (known.expiry == EXPIRIES[4]) & (known.strike == 100.0)
    chain = {
        name: column[rows]
        for name, column in known.chain(known.price).items()
        if isinstance(column, np.ndarray)
    }
    carry = fit_carry(read_pairs({**chain, "spot": 100.0, "rate": RATE}), tolerance=TOLERANCE)
    assert carry.pairs_used.tolist() == [1]
    assert abs(carry.dividend_yield[0] - RATE) < 0.1 * BASIS_POINT
    assert 0.0 < carry.standard_error[0] < 0.01


def test_it_ends_when_it_is_told_to(known):
    with pytest.raises(NumericalError, match="interrupted"):
        fit_carry(read_pairs(known.chain(known.price)), tolerance=TOLERANCE, interrupt=lambda: True)
