import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core import kernel_name
from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    implied_volatility,
    implied_volatility_many,
    price,
    price_many,
)
from pricing_core.american.book.book import Book
from pricing_core.american.book.reading import read_book
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.price_bounds import bounds_of
from pricing_core.american.engines.solve import CLOSED_FORM, solve
from pricing_core.american.implied.black_spread import black_spread, black_time_value
from pricing_core.american.implied.volatility_search import search
from pricing_core.american.implied.volatility_targets import Targets
from pricing_core.errors import InvalidInputError
from tests.problems.interrupted import Deadline
from tests.problems.needs_kernel import needs_kernel

COMPILED = kernel_name() == "rust"  # without it a price takes some hundred times as long
PUT, CALL = Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)
PLAIN = Market(100.0, 0.05, 0.2)


def random_contracts(count, seed, exercise="american"):
    rng = np.random.default_rng(seed)
    return {
        "option_type": np.where(rng.random(count) < 0.5, "put", "call"),
        "exercise": exercise,
        "spot": rng.uniform(60.0, 150.0, count),
        "strike": 100.0,
        "expiry": rng.uniform(20 / 365, 3.0, count),
        "rate": rng.uniform(0.0, 0.1, count),
        "dividend_yield": rng.uniform(0.0, 0.1, count),
        "volatility": rng.uniform(0.1, 0.6, count),
    }


@needs_kernel
@pytest.mark.parametrize("tolerance", [1e-5, 1e-6])
@pytest.mark.parametrize("exercise", ["american", "european"])
def test_prices_at_the_implied_volatility_are_the_ones_observed(exercise, tolerance):
    contracts = random_contracts(5000 if COMPILED else 300, 7, exercise)
    observed = price_many(contracts, tolerance=1e-7, greeks="none")
    table = implied_volatility_many(contracts, observed["price"], tolerance=tolerance)
    ok = table["status"] == "ok"
    assert np.isin(table["status"], ["ok", "not_identifiable"]).all()
    assert not observed["exercise_now"][ok].any()
    assert ok.mean() > 0.9
    assert np.max(np.abs(table["price"] - observed["price"])[ok]) <= tolerance * 100.0
    columns = {name: column[ok] if np.ndim(column) else column for name, column in contracts.items()}
    again = price_many({**columns, "volatility": table["volatility"][ok]}, tolerance=1e-7, greeks="none")
    assert np.max(np.abs(again["price"] - observed["price"][ok])) <= tolerance * 100.0
    assert np.allclose(again["european_price"], table["european_price"][ok], rtol=0, atol=1e-8)


def test_negative_rates_and_two_boundaries_are_served_too():
    for option, market in (
        (Option("put", 100.0, 1.0), Market(90.0, -0.02, 0.2, -0.05)),  # exercised between two boundaries
        (Option("call", 100.0, 1.0), Market(115.0, -0.05, 0.2, -0.02)),
        (Option("put", 100.0, 1.0), Market(90.0, -0.03, 0.2, 0.01)),  # never exercised
    ):
        observed = price(option, market, tolerance=1e-5).price
        found = implied_volatility(option, market, observed, tolerance=1e-5)
        assert found.status == "ok"
        assert abs(found.price - observed) <= 1e-5 * 100.0
        assert found.volatility == pytest.approx(0.2, abs=1e-3)


def with_dividends(contracts, seed):
    """Return the contracts with one to three cash dividends each before expiry."""
    rng = np.random.default_rng(seed)
    cash = [
        [{"time": time, "amount": rng.uniform(0.2, 2.0)} for time in rng.uniform(0.0, T, rng.integers(1, 4))]
        for T in contracts["expiry"].tolist()
    ]
    return {**contracts, "cash_dividends": cash}


@needs_kernel
@pytest.mark.parametrize("count", [60 if COMPILED else 4, pytest.param(5000, marks=pytest.mark.nightly)])
def test_prices_with_cash_dividends_are_met_too(count):
    tolerance = 1e-5
    contracts = with_dividends(random_contracts(count, 11), 12)
    observed = price_many(contracts, tolerance=1e-6, greeks="none")
    table = implied_volatility_many(contracts, observed["price"], tolerance=tolerance)
    ok = table["status"] == "ok"
    assert np.isin(table["status"], ["ok", "not_identifiable", "no_convergence"]).all()
    assert (table["status"] == "no_convergence").mean() <= 1e-3  # where the engine's errors are large
    assert ok.mean() > 0.7
    assert np.max(np.abs(table["price"] - observed["price"])[ok]) <= tolerance * 100.0
    error = np.abs(table["volatility"] - contracts["volatility"])[ok]
    assert np.median(error) < 1e-4
    row = int(np.flatnonzero(ok)[0])
    cells = {
        name: np.broadcast_to(column, count)[row].item()
        for name, column in random_contracts(count, 11).items()
    }
    market = Market(
        cells["spot"], cells["rate"], 0.9, cells["dividend_yield"], contracts["cash_dividends"][row]
    )
    option = Option(cells["option_type"], cells["strike"], cells["expiry"])
    single = implied_volatility(option, market, observed["price"][row], tolerance=tolerance)
    assert single.volatility == table["volatility"][row]


@pytest.mark.parametrize(
    ("option", "market"),
    [
        (Option("put", 100.0, 1.0, "bermudan", exercise_times=(0.25, 0.5, 0.75)), PLAIN),
        (Option("call", 100.0, 1.0), Market(100.0, PiecewiseConstant([0.5, 1.0], [0.02, 0.06]), 0.2, 0.03)),
        (
            Option("put", 100.0, 1.0),
            Market(100.0, 0.05, 0.2, cash_dividends=[CashDividend(0.5, 3.0)], dividend_model="escrowed"),
        ),
        (
            Option("call", 100.0, 1.0, "european"),
            Market(100.0, 0.05, 0.2, proportional_dividends=[ProportionalDividend(0.5, 0.03)]),
        ),
    ],
)
def test_contracts_with_other_events_have_implied_volatilities(option, market):
    observed = price(option, market, tolerance=1e-6, greeks="none").price
    found = implied_volatility(option, market, observed, tolerance=1e-5)
    assert found.status == "ok"
    assert found.volatility == pytest.approx(0.2, abs=1e-4)
    assert abs(found.price - observed) <= 1e-5 * option.strike


@needs_kernel
def test_the_volatility_is_recovered_where_vega_is_not_tiny():
    contracts = random_contracts(2000 if COMPILED else 50, 8)
    observed = price_many(contracts, tolerance=1e-8)
    table = implied_volatility_many(contracts, observed["price"], tolerance=1e-7)
    visible = observed["vega"] > 1.0  # money, for a strike of 100
    assert (table["status"][visible] == "ok").all()
    error = np.abs(table["volatility"] - contracts["volatility"])[visible]
    assert np.max(error * observed["vega"][visible]) <= 3e-5  # three tolerances of the strike
    assert table["iterations"][visible].mean() < 5.0


@needs_kernel
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_a_volatility_is_as_close_as_its_error_says(tolerance):
    contracts = random_contracts(2000 if COMPILED else 50, 18)
    observed = price_many(contracts, tolerance=1e-8)
    table = implied_volatility_many(contracts, observed["price"], tolerance=tolerance)
    ok, claimed = table["status"] == "ok", table["volatility_error"]
    np.testing.assert_array_equal(np.isnan(claimed), ~ok)
    # Where the price observed is itself exact by comparison.
    known = ok & (observed["error_estimate"] < 0.1 * claimed * observed["vega"])
    assert known.sum() > (1000 if COMPILED else 25)
    share = (np.abs(table["volatility"] - contracts["volatility"]) / claimed)[known]
    assert np.mean(share <= 1.0) > 0.97
    assert share.max() < 4.0


@needs_kernel
@pytest.mark.parametrize("dividends", [[], [{"time": 0.05, "amount": 1.0}]], ids=["flat", "dividend"])
def test_the_error_of_a_volatility_is_that_of_the_price_and_the_gap_over_vega(dividends):
    contracts = random_contracts(500 if COMPILED and not dividends else 30, 19) | {
        "cash_dividends": dividends
    }
    observed = price_many(contracts, tolerance=1e-8, greeks="none")["price"]
    table = implied_volatility_many(contracts, observed, tolerance=1e-5)
    found = np.where(table["status"] == "ok", table["volatility"], 0.2)
    vega = price_many(contracts | {"volatility": found}, tolerance=1e-7)["vega"]
    with np.errstate(all="ignore"):
        expected = (table["error_estimate"] + np.abs(table["price"] - observed)) / vega
    # A vega that is nothing but error tells nothing.
    visible = (table["status"] == "ok") & (expected < 0.01 * found) & (vega > 0.0)
    assert visible.sum() > 0.7 * observed.size
    np.testing.assert_allclose(table["volatility_error"][visible], expected[visible], rtol=0.2)


@pytest.mark.parametrize("error", [1e-3, 2.0, 6.0, 9.0])
def test_a_volatility_whose_price_is_uncertain_lies_as_far_from_those_of_the_ends(error):
    option, market = Option("call", 100.0, 1.0, "european"), Market(100.0, 0.03, 0.2, 0.01)
    observed, tolerance = 8.0, np.array([1e-2])
    book = Book.of([(option, market)])

    def price_at(rows, volatility, tolerance, vega):
        found = solve(book.with_volatility(volatility), Request(tolerance), engines=(CLOSED_FORM,))
        return replace(found, error=np.array([error]))

    targets = Targets(np.array([observed]), bounds_of(book), book.spot, book.strike, book.expiry, tolerance)
    found = search(targets, price_at)
    volatility, price_there = found.volatility[0], found.price[0]
    uncertain = error + abs(price_there - observed)
    low, high = (
        implied_volatility(option, market, price_there + side * uncertain, tolerance=1e-8).volatility
        if price_there + side * uncertain > bounds_of(book).lower[0]
        else 0.0
        for side in (-1.0, 1.0)
    )
    expected = max(volatility - low, high - volatility)
    assert found.volatility_error[0] == pytest.approx(expected, rel=0.05)


@needs_kernel
def test_rows_equal_single_searches_bit_for_bit_whatever_their_neighbours():
    contracts = random_contracts(600, 9)
    prices = price_many(contracts, tolerance=1e-6, greeks="none")["price"]
    table = implied_volatility_many(contracts, prices, tolerance=1e-5, threads=2)
    for row in (0, 17, 599):
        cells = {name: np.broadcast_to(column, 600)[row].item() for name, column in contracts.items()}
        option = Option(cells["option_type"], cells["strike"], cells["expiry"])
        market = Market(cells["spot"], cells["rate"], 0.9, cells["dividend_yield"])
        single = implied_volatility(option, market, prices[row], tolerance=1e-5)
        assert single.status == table["status"][row]
        assert single.iterations == table["iterations"][row]
        for name in ("volatility", "volatility_error", "price", "european_price"):
            assert getattr(single, name) == table[name][row] or math.isnan(table[name][row])


@pytest.mark.parametrize(
    ("option", "market", "observed", "status"),
    [
        (PUT, Market(70.0, 0.05, 0.2), 29.9, "below_lower_bound"),
        (PUT, Market(70.0, 0.05, 0.2), 29.99995, "not_identifiable"),  # half the tolerance below
        (PUT, Market(70.0, 0.05, 0.2), 30.0, "not_identifiable"),
        (PUT, Market(70.0, 0.05, 0.2), 30.01, "ok"),
        (PUT, PLAIN, 0.0, "not_identifiable"),
        (PUT, PLAIN, 100.0, "above_upper_bound"),
        (PUT, Market(100.0, -0.05, 0.2, -0.02), 100.1, "ok"),  # interest is earned by waiting
        (PUT, Market(100.0, -0.05, 0.2, -0.02), 100.0 * math.exp(0.05), "above_upper_bound"),
        (CALL, PLAIN, 100.0, "above_upper_bound"),
        (CALL, PLAIN, 4.87, "below_lower_bound"),  # 100 - 100 e^{-0.05} = 4.877
        (CALL, PLAIN, 4.88, "ok"),
        (CALL, Market(100.0, 0.05, 0.2, -0.02), 101.0, "ok"),
        (CALL, Market(100.0, 0.05, 0.2, -0.02), 100.0 * math.exp(0.02), "above_upper_bound"),
        (Option("put", 100.0, 1.0, "european"), PLAIN, 95.2, "above_upper_bound"),  # 100 e^{-0.05} = 95.12
        (
            Option("put", 100.0, 1.0, "european"),
            Market(70.0, 0.05, 0.2),
            25.2,
            "ok",
        ),  # 25.12 at no volatility
        (Option("call", 100.0, 1.0, "european"), Market(100.0, 0.0, 0.2, 0.1), 90.5, "above_upper_bound"),
        (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2), 10.0, "not_identifiable"),
        (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2), 10.1, "above_upper_bound"),
        (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2), 9.9, "below_lower_bound"),
        (Option("call", 100.0, 1.0), Market(0.0, 0.05, 0.2), 0.0, "not_identifiable"),
        (Option("put", 100.0, 1e-5), PLAIN, 20.0, "above_upper_bound"),  # 15 is not enough so near expiry
    ],
)
def test_every_price_gets_its_status(option, market, observed, status):
    found = implied_volatility(option, market, observed)
    assert found.status == status
    numbers = (found.volatility, found.volatility_error, found.price, found.european_price)
    assert [number is None for number in numbers] == [status != "ok"] * 4
    if status == "ok":
        assert found.price == pytest.approx(observed, abs=1e-6 * option.strike)


def test_a_price_that_the_engine_cannot_give_ends_without_convergence(monkeypatch):
    def refuse(*arguments, **options):
        raise ArithmeticError

    monkeypatch.setattr("pricing_core.kernel.march_segments", None)
    monkeypatch.setattr("pricing_core.american.engines.obstacle_march.pricing.contract_problem", refuse)
    general = Market(90.0, -0.02, 0.2, -0.05, cash_dividends=[CashDividend(0.5, 1.0)])  # two boundaries
    assert implied_volatility(PUT, general, 14.0).status == "no_convergence"


@needs_kernel
def test_an_interrupted_search_ends_without_convergence():
    market = Market(100.0, 0.05, 0.2, cash_dividends=[CashDividend(0.5, 1.0)])
    assert implied_volatility(PUT, market, 6.5, interrupt=lambda: True).status == "no_convergence"
    assert implied_volatility(PUT, market, 6.5, interrupt=lambda: False).status == "ok"


def test_a_search_on_the_general_path_is_interrupted_in_the_midst_of_a_price():
    market = Market(90.0, -0.02, 0.2, -0.05, cash_dividends=[CashDividend(0.5, 1.0)])  # two boundaries
    whole = Deadline()
    assert implied_volatility(PUT, market, 14.0, interrupt=whole).status == "ok"
    cut = Deadline(2 * whole.asked // 3)
    found = implied_volatility(PUT, market, 14.0, interrupt=cut)
    assert (found.status, found.volatility) == ("no_convergence", None)
    assert cut.asked < whole.asked


def test_the_spread_of_a_time_value_is_found_at_any_moneyness():
    rng = np.random.default_rng(2)
    k, spread = 10.0 ** rng.uniform(-6.0, 1.0, 2000), 10.0 ** rng.uniform(-2.0, 1.0, 2000)
    value, slope = black_time_value(k, spread)
    visible = (value > 1e-12) & (value < 1.0 - 1e-9)
    found = black_spread(k[visible], value[visible])
    again, _ = black_time_value(k[visible], found)
    assert np.max(np.abs(again / value[visible] - 1.0)) < 1e-6
    exact = np.abs(found - spread[visible]) * slope[visible]
    assert np.max(exact / (value * (1.0 - value))[visible]) < 1e-6
    assert black_spread(np.zeros(3), np.array([-1.0, 0.0, 1.0])).tolist() == [0.0, 0.0, math.inf]


@needs_kernel
def test_a_call_is_the_put_with_spot_and_strike_exchanged():
    put = implied_volatility(Option("put", 110.0, 0.7), Market(95.0, 0.06, 0.2, 0.02), 17.0, tolerance=1e-7)
    call = implied_volatility(Option("call", 95.0, 0.7), Market(110.0, 0.02, 0.2, 0.06), 17.0, tolerance=1e-7)
    assert put.volatility == pytest.approx(call.volatility, abs=1e-6)
    assert put.european_price == pytest.approx(call.european_price, abs=1e-4)


def test_the_implied_volatility_of_a_european_option_is_that_of_the_closed_formula():
    market = Market(100.0, 0.03, 0.27, 0.01)
    for option_type in ("put", "call"):
        for strike in (40.0, 100.0, 250.0):
            option = Option(option_type, strike, 2.0, "european")
            observed = price(option, market).price
            found = implied_volatility(option, market, observed, tolerance=1e-8)
            assert found.volatility == pytest.approx(0.27, abs=1e-6)
            assert found.european_price == found.price


def test_a_tiny_time_value_deserves_a_volatility_too():
    option, market = Option("call", 100.0, 0.1), Market(70.0, 0.03, 0.25, 0.01)
    observed = price(option, market, tolerance=1e-8).price
    assert observed < 1e-5
    assert implied_volatility(option, market, observed).volatility == pytest.approx(0.25, abs=2e-3)


@needs_kernel
def test_quotes_have_three_volatilities():
    found = implied_volatility(PUT, PLAIN, bid=6.0, ask=6.2)
    assert found.bid_volatility < found.volatility < found.ask_volatility
    assert found.volatility == implied_volatility(PUT, PLAIN, 6.1).volatility
    assert found.bid_volatility == pytest.approx(implied_volatility(PUT, PLAIN, 6.0).volatility, abs=1e-9)
    deep = implied_volatility(PUT, Market(70.0, 0.05, 0.2), bid=29.5, ask=31.0)
    assert (deep.status, deep.bid_volatility) == ("ok", None)
    assert deep.ask_volatility > deep.volatility
    assert implied_volatility(PUT, PLAIN, 6.1).bid_volatility is None


@pytest.mark.parametrize(
    ("field", "quote"),
    [
        ("option_price", {"option_price": math.nan}),
        ("option_price", {"option_price": -1.0}),
        ("option_price", {"option_price": "6.1"}),
        ("option_price", {"option_price": 6.0, "ask": 6.2}),
        ("option_price", {}),
        ("bid", {"ask": 6.2}),
        ("bid", {"bid": -0.1, "ask": 6.2}),
        ("ask", {"bid": 6.0}),
        ("ask", {"bid": 6.0, "ask": math.inf}),
        ("ask", {"bid": 6.3, "ask": 6.2}),
        ("ask", {"bid": 0.0, "ask": 0.0}),
        ("tolerance", {"option_price": 6.0, "tolerance": 0.0}),
    ],
)
def test_nonsense_is_refused_by_name(field, quote):
    with pytest.raises(InvalidInputError) as refusal:
        implied_volatility(PUT, PLAIN, **quote)
    assert refusal.value.field == field


@needs_kernel
def test_nonsense_in_a_table_gets_a_status_and_a_message():
    columns = {"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    table = implied_volatility_many(columns, [6.1, math.nan, None, -1.0, "6"])
    assert table["status"].tolist() == ["ok", *["invalid_input"] * 4]
    assert table["message"][3] == "option_price = -1.0: must be a finite number >= 0"
    assert np.isnan(table["volatility"][1:]).all()
    quotes = implied_volatility_many(columns, bid=[6.0, 6.3, 0.0, -1.0, 0.0], ask=[6.2, 6.2, 0.0, 1.0, 0.1])
    assert quotes["status"].tolist() == ["ok", *["invalid_input"] * 3, "ok"]
    assert quotes["message"][1] == "ask = 6.2: must be above 0 and at least the bid, 6.3"
    assert quotes["bid_volatility"][0] < quotes["volatility"][0] < quotes["ask_volatility"][0]
    assert np.isnan(quotes["bid_volatility"][4])  # nobody bids
    contracts = implied_volatility_many({**columns, "spot": [100.0, -1.0]}, 6.1)
    assert contracts["status"].tolist() == ["ok", "invalid_input"]
    assert contracts["message"][1] == "spot = -1.0: must be a number from 0 to 1e+30"
    assert implied_volatility_many({**columns, "spot": []}, [])["volatility"].shape == (0,)


@pytest.mark.parametrize(
    ("columns", "options"),
    [
        ({}, {}),
        ({}, {"option_price": 6.0, "bid": 5.0, "ask": 7.0}),
        ({}, {"bid": 5.0}),
        ({"spot": [100.0, 101.0]}, {"option_price": [6.0, 6.0, 6.0]}),
        ({"colour": "blue"}, {"option_price": 6.0}),
        ({}, {"option_price": 6.0, "threads": 0}),
    ],
)
def test_a_table_as_a_whole_can_be_refused(columns, options):
    contract = {"option_type": "put", "spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    with pytest.raises(InvalidInputError):
        implied_volatility_many({**contract, **columns}, **options)


def bounds(option, market):
    return bounds_of(Book.of([(option, market)]))


def test_bounds_do_not_depend_on_the_volatility_or_on_the_other_rows():
    read = read_book(random_contracts(200, 3), 1e-6)
    dividends = read_book(with_dividends(random_contracts(50, 4), 5), 1e-6)
    book = Book.concatenated([read.book, dividends.book])
    together = bounds_of(book)
    other = bounds_of(book.with_volatility(np.full(book.count, 1.7)))
    for name in together.__slots__:
        np.testing.assert_array_equal(getattr(together, name), getattr(other, name), err_msg=name)
    for row in range(0, book.count, 7):
        alone = bounds_of(book.take(np.array([row])))
        for name in together.__slots__:
            assert getattr(alone, name)[0] == getattr(together, name)[row], name


@pytest.mark.parametrize("exercise", ["american", "european"])
def test_bounds_without_events_are_mertons(exercise):
    """At no volatility the best of both ends and the time between; at an infinite one K and S with their interest."""
    contracts = random_contracts(300, 6, exercise)
    contracts["rate"] -= 0.03
    contracts["dividend_yield"] -= 0.03
    found = bounds_of(read_book(contracts, 1e-6).book)
    put, american = contracts["option_type"] == "put", exercise == "american"
    sign, K, S, T = np.where(put, 1.0, -1.0), 100.0, contracts["spot"], contracts["expiry"]
    r, q = contracts["rate"], contracts["dividend_yield"]
    times = np.linspace(0.0, 1.0, 4001)[:, None] * T
    paid = sign * (K * np.exp(-r * times) - S * np.exp(-q * times))
    lower = np.maximum(paid.max(axis=0) if american else paid[-1], 0.0)
    np.testing.assert_allclose(found.lower, lower, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.european_lower, np.maximum(paid[-1], 0.0), rtol=0.0, atol=1e-12)
    stock, bond = S * np.exp(-q * T), K * np.exp(-r * T)
    if american:
        stock, bond = np.maximum(stock, S), np.maximum(bond, K)
    np.testing.assert_allclose(found.upper, np.where(put, bond, stock), rtol=1e-14)
    assert np.all(found.lower <= found.upper)
    now = sign * (K - S)
    np.testing.assert_array_equal(found.at_once, (now > 0.0) & (now >= found.lower) & american)


@needs_kernel
def test_prices_lie_between_the_bounds_and_tend_to_them():
    dividends = with_dividends(random_contracts(40, 13), 14)
    found = bounds_of(read_book(dividends, 1e-6).book)
    for volatility in (0.01, 0.3, 3.0, 5.0):
        table = price_many({**dividends, "volatility": volatility}, tolerance=1e-3, greeks="none")
        assert np.all(table["price"] >= found.lower - table["error_estimate"] - 1e-9)
        assert np.all(table["price"] <= found.upper + table["error_estimate"])


def test_bounds_with_dividends_can_be_computed_by_hand():
    cash = Market(100.0, 0.05, 0.2, cash_dividends=[CashDividend(0.5, 4.0)])
    put = bounds(Option("put", 110.0, 1.0), cash)
    just_after = 110.0 * math.exp(-0.025) - (100.0 - 4.0 * math.exp(-0.025))  # worth more than 10 now
    assert put.lower[0] == pytest.approx(just_after)
    assert put.upper[0] == 110.0
    assert not put.at_once[0]
    proportional = Market(100.0, 0.0, 0.2, proportional_dividends=[ProportionalDividend(0.5, 0.1)])
    call = bounds(Option("call", 80.0, 1.0, "european"), proportional)
    assert (call.lower[0], call.upper[0]) == (pytest.approx(10.0), pytest.approx(90.0))
    escrowed = Market(100.0, 0.0, 0.2, cash_dividends=[CashDividend(0.5, 10.0)], dividend_model="escrowed")
    call = bounds(Option("call", 80.0, 1.0), escrowed)
    assert (call.lower[0], call.upper[0]) == (pytest.approx(20.0), pytest.approx(90.0))
    bermudan = Option("put", 100.0, 1.0, "bermudan", exercise_times=(0.5,))
    curve = Market(90.0, PiecewiseConstant([0.5, 1.0], [0.02, 0.1]), 0.2)
    put = bounds(bermudan, curve)
    assert put.lower[0] == pytest.approx(100.0 * math.exp(-0.01) - 90.0)
    assert put.upper[0] == pytest.approx(100.0 * math.exp(-0.01))


@pytest.mark.parametrize(
    ("price", "status", "bound", "words"),
    [
        (10.0, "below_lower_bound", 20.0, "at least 20, what the option is worth at volatility 0; it is 10"),
        (
            20.0,
            "not_identifiable",
            20.0,
            "above 20, what the option is worth at a whole interval of volatilities",
        ),
        (
            200.0,
            "above_upper_bound",
            100.0,
            "below 100, what the option is worth at the largest volatility; it is 200",
        ),
    ],
)
def test_a_price_without_volatility_is_told_its_bound(price, status, bound, words):
    option, market = Option("put", 100.0, 1.0), Market(80.0, 0.05, 0.2)
    found = implied_volatility(option, market, price)
    assert (found.status, found.price_bound) == (status, bound)
    assert words in found.message
    row = {"option_type": "put", "spot": 80.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    table = implied_volatility_many(row, option_price=[price, 21.0])
    assert (table["status"].tolist(), table["price_bound"][0]) == ([status, "ok"], bound)
    assert table["message"].tolist() == [found.message, ""]
    assert np.isnan(table["price_bound"][1])


def test_a_price_above_that_of_the_largest_volatility_is_told_that():
    """A short life: even at the largest volatility the option is far from its limit."""
    option, market = Option("put", 100.0, 1e-3), Market(100.0, 0.05, 15.0)
    most = price(option, market, tolerance=1e-8).price
    found = implied_volatility(option, market, most + 1.0)
    assert found.status == "above_upper_bound"
    assert found.price_bound == pytest.approx(most, abs=1e-3)
