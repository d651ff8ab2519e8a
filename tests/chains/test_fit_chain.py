import datetime as dt
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pricing_core.american import Market, Option, price
from pricing_core.chains import FLAGS, fit_chain, read_chain
from pricing_core.errors import InvalidInputError, NumericalError
from tests.chains.chain_problems import DISPLACEMENT, EXPIRIES, LEVEL, RATE, SPOT, displaced_chain

DATE = dt.date(2026, 3, 2)
BASIS_POINT = 1e-4
REAL = Path(__file__).parents[3] / "shared" / "references" / "market" / "aapl_2014-06-06.csv"
EX_DATES = ("2014-08-07", "2014-11-06", "2015-02-05", "2015-05-07", "2015-08-06", "2015-11-05")


def table_of(known, mid, **more):
    days = np.rint(known.expiry * 365.0).astype(int).tolist()
    count = len(days)
    return {
        "symbol": ["XYZ"] * count,
        "underlying_price": [SPOT] * count,
        "quote_date": [DATE] * count,
        "expiration": [DATE + dt.timedelta(days=day) for day in days],
        "strike": known.strike,
        "option_type": known.option_type,
        "bid": np.maximum(mid - known.half_spread, 0.0),
        "ask": mid + known.half_spread,
        **more,
    }


@pytest.fixture(scope="module")
def known():
    return displaced_chain()


@pytest.fixture(scope="module")
def fit(known):
    return fit_chain(table_of(known, known.price), RATE)


def column(fit, name):
    return np.array(fit.quotes[name].to_numpy(zero_copy_only=False), dtype=float)


def near(known):
    """Return which quotes lie within two standard deviations of the forward."""
    return np.abs(np.log(known.strike / SPOT)) <= 2.0 * LEVEL * np.sqrt(known.expiry)


def test_the_carry_is_recovered_to_a_basis_point(fit):
    found = fit.carry["dividend_yield"].to_numpy()
    np.testing.assert_allclose(found, RATE, rtol=0.0, atol=BASIS_POINT)
    assert fit.carry["status"].to_pylist() == ["ok"] * EXPIRIES.size
    assert fit.unfitted == {}


def test_volatilities_are_recovered(fit, known):
    # One by one, out of the money, and by the surface, everywhere.
    mid = column(fit, "mid_volatility")
    out = (known.option_type == "call") == (known.strike >= SPOT)
    assert np.abs(mid - known.volatility)[near(known) & out].max() < 4e-4
    for expiry in EXPIRIES.tolist():
        rows = (known.expiry == expiry) & near(known)
        found = fit.surface.volatility(known.strike[rows], expiry)
        np.testing.assert_allclose(found, known.volatility[rows], rtol=0.0, atol=4e-4)


def test_the_local_volatility_is_recovered_to_a_hundredth(fit):
    for time in (EXPIRIES[1:-1] * 0.8).tolist():
        spots = SPOT * np.exp(np.linspace(-2.0, 2.0, 41) * LEVEL * math.sqrt(time))
        truth = LEVEL * SPOT / (SPOT + DISPLACEMENT) * (spots + DISPLACEMENT) / spots
        np.testing.assert_allclose(fit.local_volatility.at(time, spots), truth, rtol=0.01)


def test_the_american_quotes_reprice(fit, known):
    miss = np.abs(column(fit, "model_price") - known.price) / SPOT
    assert np.mean(miss < 1e-5) > 0.98
    assert miss.max() < 2e-5  # next to the exercise boundary, where the premium has a kink
    assert fit.share_within_after == 1.0


def test_the_market_of_the_fit_prices_the_quotes(fit, known):
    assert isinstance(fit.market, Market)
    for row in np.random.default_rng(5).choice(np.flatnonzero(near(known)), 4, replace=False).tolist():
        option = Option(str(known.option_type[row]), known.strike.item(row), known.expiry.item(row))
        assert abs(price(option, fit.market, tolerance=1e-5).price - known.price[row]) < 3e-5 * SPOT


def test_every_row_comes_back_in_order_with_its_results(fit, known):
    assert fit.quotes.num_rows == known.strike.size
    assert column(fit, "strike").tolist() == known.strike.tolist()
    for name in (
        "expiry",
        "bid_volatility",
        "ask_volatility",
        "european_price",
        "model_price",
        "status",
        "flags",
    ):
        assert name in fit.quotes.schema.names
    low, middle, high = (column(fit, f"{name}_volatility")[near(known)] for name in ("bid", "mid", "ask"))
    status = np.array(fit.quotes["status"].to_pylist(), dtype=object)[near(known)]
    assert set(status) <= {"ok", "not_identifiable", "below_lower_bound"}  # the latter are exercised now
    found = status == "ok"
    assert np.all(middle[found] < high[found])
    assert not np.any(low[found] >= middle[found])


def test_a_fit_of_a_fit_is_the_same(fit, known):
    again = fit_chain(fit.quotes, RATE)
    assert again.quotes.equals(fit.quotes)


@pytest.mark.nightly
def test_with_noise_the_errors_are_those_that_the_fit_reports(known):
    rng = np.random.default_rng(20_261_124)
    carry, volatility = [], []
    for _ in range(20):
        mid = known.price + known.half_spread * rng.standard_normal(known.price.size)
        found = fit_chain(table_of(known, mid), RATE)
        error = found.carry["standard_error"].to_numpy()
        carry.append((found.carry["dividend_yield"].to_numpy() - RATE) / error)
        for expiry in EXPIRIES.tolist():
            rows = (known.expiry == expiry) & near(known) & (known.option_type == "call")
            strike = known.strike[rows]
            off = found.surface.volatility(strike, expiry) - known.volatility[rows]
            volatility.append(off / found.surface.standard_error(strike, expiry))
    assert np.mean(np.abs(carry) < 2.0) >= 0.93
    assert np.mean(np.abs(np.concatenate(volatility)) < 2.0) >= 0.93


def small(known, rows):
    part = table_of(known, known.price)
    return {name: np.asarray(cells)[rows].tolist() for name, cells in part.items()}


def test_bad_rows_and_expiries_do_not_stop_the_others(known):
    rows = np.isin(known.expiry, EXPIRIES[[2, 4]]) & (np.abs(known.strike - SPOT) < 12.0)
    columns = small(known, rows)
    count = len(columns["strike"])
    more = {name: [cells[0], cells[1], cells[2], cells[3]] for name, cells in columns.items()}
    more["strike"][0] = "abc"
    more["expiration"][1] = DATE - dt.timedelta(days=3)
    more["expiration"][2] = more["expiration"][3] = DATE + dt.timedelta(days=500)  # calls alone
    joined = {name: [*cells, *more[name]] for name, cells in columns.items()}
    fit = fit_chain(read_chain({name: [*map(str, cells)] for name, cells in joined.items()}), RATE)
    assert fit.quotes["status"].to_pylist()[:count] == ["ok"] * count
    assert fit.quotes["status"].to_pylist()[count : count + 2] == ["invalid_input"] * 2
    assert fit.flags["unreadable"] == 1
    assert fit.flags["expired"] == 1
    assert list(fit.unfitted) == [str(DATE + dt.timedelta(days=500))]
    assert fit.rejected == 1


def test_calls_alone_are_fitted_without_a_carry(known):
    rows = (known.option_type == "call") & (known.expiry == EXPIRIES[3])
    fit = fit_chain(small(known, rows), RATE)
    assert set(fit.quotes["flags"].to_pylist()) == {"no_carry"}
    assert fit.carry["dividend_yield"].to_pylist() == [0.0]
    assert set(fit.unfitted.values()) == {"carry: no_pairs"}
    assert set(fit.quotes["status"].to_pylist()) <= {"ok", "below_lower_bound"}
    assert fit.surface is None


def test_a_single_strike_is_fitted(known):
    rows = (known.strike == SPOT) & (known.expiry == EXPIRIES[4])
    fit = fit_chain(small(known, rows), RATE)
    assert fit.quotes["status"].to_pylist() == ["ok", "ok"]
    assert fit.carry["pairs_used"].to_pylist() == [1]


def test_european_chains_are_fitted_without_taking_exercise_out(known):
    rows = known.expiry == EXPIRIES[3]
    columns = {**small(known, rows), "exercise": ["european"] * int(rows.sum())}
    fit = fit_chain(columns, RATE)
    assert fit.carry["status"].to_pylist() == ["ok"]
    assert fit.share_within_before == fit.share_within_after
    inside = near(known)[rows]
    np.testing.assert_allclose(column(fit, "european_price")[inside], known.price[rows][inside], atol=1e-3)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({}, "rate"),
        ({"rate": 5.0}, "rate"),
        ({"rate": RATE, "tolerance": 1.0}, "tolerance"),
        ({"rate": RATE, "valuation_date": "soon"}, "valuation_date"),
        ({"rate": RATE, "cash_dividends": [{"amount": 1.0}]}, "cash_dividends[0].time"),
        ({"rate": RATE, "threads": 0}, "threads"),
    ],
)
def test_a_wrong_argument_is_named(known, options, field):
    with pytest.raises(InvalidInputError) as caught:
        fit_chain(small(known, known.expiry == EXPIRIES[0]), **options)
    assert caught.value.field == field


@pytest.mark.parametrize("soon", [1, 4, 6, 100])
def test_it_ends_when_it_is_told_to(known, soon):
    asked = []

    def after_some_time():
        asked.append(True)
        return len(asked) > soon

    with pytest.raises(NumericalError, match="interrupted"):
        fit_chain(small(known, known.expiry == EXPIRIES[0]), RATE, interrupt=after_some_time)


@pytest.mark.skipif(not REAL.exists(), reason="the real chain is not beside the project")
def test_the_quotes_of_a_real_chain_have_volatilities():
    table = read_chain(REAL)
    kept = np.isin(
        [day.isoformat() for day in table["expiration"].to_pylist()],
        ("2014-06-06", "2014-08-16", "2014-10-18"),
    )
    fit = fit_chain(
        table.filter(pa.array(kept)),
        0.0053,
        cash_dividends=[{"ex_date": day, "amount": 3.29} for day in EX_DATES],
        valuation_date="2014-06-06T11:00",
    )
    bid, ask, strike = (column(fit, name) for name in ("bid", "ask", "strike"))
    call = np.array(fit.quotes["option_type"].to_pylist()) == "call"
    intrinsic = np.where(call, fit.market.spot - strike, strike - fit.market.spot)
    two_sided = (bid > 0.0) & (ask >= bid) & (0.5 * (bid + ask) > intrinsic)
    status = np.array(fit.quotes["status"].to_pylist(), dtype=object)
    assert np.mean(status[two_sided] == "ok") >= 0.97
    mismatched = ["put_call_mismatch" in words for words in fit.quotes["flags"].to_pylist()]
    assert np.mean(mismatched) < 0.1
    assert fit.share_within_after >= 0.9
    assert fit.unfitted == {}  # not even what has five hours left
    assert set(fit.flags) <= set(FLAGS)
