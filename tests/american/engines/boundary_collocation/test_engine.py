"""The collocation of two boundaries against the general march, identities, and differences of its own prices."""

import math

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american import CashDividend, Market, Option, price_many
from pricing_core.american.book.book import Book
from pricing_core.american.engines.boundary_collocation import BoundaryCollocation
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
ENGINE = BoundaryCollocation()
PUT, CALL = Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)
MARKET = Market(90.0, -0.02, 0.2, -0.05)
STRIKE = 100.0


def columns(count, seed, kind="everyday"):
    """Return random contracts with two boundaries, "everyday" or "wide" in their parameters."""
    random = np.random.default_rng(seed)
    is_put = random.random(count) < 0.5
    if kind == "everyday":
        near, volatility = -random.uniform(0.001, 0.03, count), random.uniform(0.05, 0.6, count)
        far, expiry = near - random.uniform(0.0005, 0.05, count), random.uniform(0.05, 3.0, count)
    else:
        near, volatility = (
            -(10.0 ** random.uniform(-5.0, -0.7, count)),
            10.0 ** random.uniform(-2.0, 0.5, count),
        )
        far = np.maximum(near * (1.0 + 10.0 ** random.uniform(-3.0, 2.0, count)), -0.9)
        expiry = 10.0 ** random.uniform(-3.0, 1.5, count)
    deviation = np.clip(volatility * np.sqrt(expiry), 0.02, 1.0)
    return {
        "option_type": np.where(is_put, "put", "call"),
        "spot": STRIKE * np.exp(deviation * random.normal(0.0, 1.0, count)),
        "strike": np.full(count, STRIKE),
        "expiry": expiry,
        "rate": np.where(is_put, near, far),
        "dividend_yield": np.where(is_put, far, near),
        "volatility": volatility,
    }


@pytest.mark.parametrize(
    ("option", "market", "served"),
    [
        (PUT, MARKET, True),
        (CALL, Market(90.0, -0.05, 0.2, -0.02), True),
        (CALL, MARKET, False),
        (PUT, Market(90.0, -0.05, 0.2, -0.02), False),
        (PUT, Market(90.0, 0.02, 0.2, -0.05), False),
        (PUT, Market(90.0, -0.02, 0.2, -0.02), False),
        (PUT, Market(0.0, -0.02, 0.2, -0.05), False),
        (PUT, Market(90.0, -0.02, 0.0, -0.05), False),
        (Option("put", 100.0, 1.0, "european"), MARKET, False),
        (PUT, Market(90.0, -0.02, 0.2, -0.05, cash_dividends=[CashDividend(0.5, 1.0)]), False),
    ],
)
def test_american_contracts_without_events_and_with_two_boundaries_are_served(option, market, served):
    assert ENGINE.serves(Book.of([(option, market)])).tolist() == [served]


def test_without_the_kernel_nothing_is_served(monkeypatch):
    monkeypatch.setattr(kernel, "price_options", None)
    assert not ENGINE.serves(Book.of([(PUT, MARKET)])).any()


@pytest.mark.parametrize(("kind", "count", "found_at_least"), [("everyday", 300, 1.0), ("wide", 300, 0.97)])
def test_estimates_cover_the_distance_to_finer_solves_and_nearly_all_are_found(kind, count, found_at_least):
    contracts = columns(count, 5, kind)
    reference = price_many(contracts, tolerance=1e-8, greeks="none")
    valid = reference["status"] != "invalid_input"
    for tolerance in (1e-4, 1e-6):
        found = price_many(contracts, tolerance=tolerance, greeks="none")
        own = found["method"] == "boundary-collocation"
        assert own[valid].mean() >= found_at_least
        off = np.abs(found["price"] - reference["price"])
        assert np.mean((off <= found["error_estimate"] + reference["error_estimate"])[own]) >= 0.98
        ok = own & (found["status"] == "ok")
        assert np.all(off[ok] <= tolerance * STRIKE + reference["error_estimate"][ok])


def test_prices_are_those_of_the_march_of_obstacle_problems():
    contracts = columns(40, 6)
    found = price_many(contracts, tolerance=1e-7, greeks="none")
    lines = price_many(contracts, tolerance=1e-6, greeks="none", method="lcs")
    assert set(found["method"]) == {"boundary-collocation"}
    assert set(lines["method"]) == {"lcs"}
    off = np.abs(found["price"] - lines["price"])
    assert np.all(off <= found["error_estimate"] + lines["error_estimate"])


def test_theta_is_what_the_other_parameters_say():
    """V depends on r T, q T and sigma sqrt(T) alone: r rho + q dividend rho + sigma vega/2 = -T theta."""
    contracts = columns(300, 7)
    found = price_many(contracts, tolerance=1e-7, greeks="standard")
    inside = found["method"] == "boundary-collocation"
    inside &= found["price"] > np.where(contracts["option_type"] == "put", 1.0, -1.0) * (
        STRIKE - contracts["spot"]
    )
    weighted = (
        contracts["rate"] * found["rho"]
        + contracts["dividend_yield"] * found["dividend_rho"]
        + 0.5 * contracts["volatility"] * found["vega"]
    )
    off = np.abs(weighted + contracts["expiry"] * found["theta"])[inside]
    assert inside.sum() > 250
    assert np.quantile(off, 0.98) < 3e-6 * STRIKE
    assert off.max() < 5e-5 * STRIKE


def test_put_and_call_are_the_same_with_everything_exchanged():
    """Call(S, K, r, q) = Put(K, S, q, r): McDonald and Schroder 1998."""
    contracts = columns(100, 8)
    exchanged = {
        **contracts,
        "option_type": np.where(contracts["option_type"] == "put", "call", "put"),
        "spot": contracts["strike"],
        "strike": contracts["spot"],
        "rate": contracts["dividend_yield"],
        "dividend_yield": contracts["rate"],
    }
    found = price_many(contracts, tolerance=1e-8, greeks="none")
    mirrored = price_many(exchanged, tolerance=1e-8, greeks="none")
    off = np.abs(found["price"] - mirrored["price"])
    assert np.all(off <= found["error_estimate"] + mirrored["error_estimate"])


@pytest.mark.parametrize(
    ("greek", "by", "of", "step", "claim"),
    [
        ("delta", "spot", "price", 1e-2, 1e-5),
        ("vega", "volatility", "price", 1e-4, 1e-3),
        ("rho", "rate", "price", 1e-5, 1e-3),
        ("dividend_rho", "dividend_yield", "price", 1e-5, 1e-3),
        ("vanna", "volatility", "delta", 1e-4, 1e-4),
        ("volga", "volatility", "vega", 1e-4, 1e-2),
    ],
)
def test_greeks_are_differences_of_prices(greek, by, of, step, claim):
    contracts = columns(150, 9)
    found = price_many(contracts, tolerance=1e-6, greeks="extended", greek_errors=True)
    moved = [
        price_many({**contracts, by: contracts[by] + shift}, tolerance=1e-8, greeks="standard")[of]
        for shift in (-2.0 * step, -step, step, 2.0 * step)
    ]
    difference = (8.0 * (moved[2] - moved[1]) - (moved[3] - moved[0])) / (12.0 * step)
    off = np.abs(found[greek] - difference)
    assert np.mean(off <= claim) >= 0.97
    assert np.mean(off <= found[f"{greek}_error"] + 0.1 * claim) >= 0.97


def test_a_row_does_not_depend_on_others_threads_or_greeks():
    contracts = columns(64, 10)
    together = price_many(contracts, tolerance=1e-6, greeks="extended", threads=2)
    for row in (0, 17, 63):
        alone = {name: column[row : row + 1] for name, column in contracts.items()}
        one = price_many(alone, tolerance=1e-6, greeks="extended")
        assert all(
            one[name][0] == together[name][row] for name in ("price", "vega", "volga", "error_estimate")
        )
    without = price_many(contracts, tolerance=1e-6, greeks="none")
    assert np.array_equal(without["price"], together["price"])


def test_strikes_of_one_expiry_share_their_solve():
    strikes = np.linspace(60.0, 140.0, 41)
    contracts = {
        "option_type": "put",
        "spot": 95.0,
        "strike": strikes,
        "expiry": 1.0,
        "rate": -0.02,
        "dividend_yield": -0.05,
        "volatility": 0.2,
    }
    apart = price_many(contracts, tolerance=1e-6, greeks="standard")
    shared = price_many(contracts, tolerance=1e-6, greeks="standard", share_solves=True)
    assert np.all(
        np.abs(apart["price"] - shared["price"]) <= apart["error_estimate"] + shared["error_estimate"]
    )


def test_between_the_boundaries_the_price_is_the_payoff():
    market = Market(60.0, -0.02, 0.2, -0.05)
    found = ENGINE.solve(Book.of([(PUT, market)]), Request(np.array([1e-6]), "extended"))
    assert found.settled[0]
    assert found.exercised[0]
    assert (found.value[0], found.delta[0], found.gamma[0], found.vega[0]) == (40.0, -1.0, 0.0, 0.0)
    ends = ENGINE.boundary(Book.of([(PUT, market)]), np.array([0.0, 0.5, 1.0]), Request(np.array([1e-6])))
    assert np.all(ends.far < ends.near)
    assert (ends.near[-1], ends.far[-1]) == (pytest.approx(100.0), pytest.approx(40.0))


def test_boundaries_are_those_of_the_march_of_obstacle_problems_until_they_meet():
    option, market = Option("put", 100.0, 5.0), Market(100.0, -0.005, 0.2, -0.01)
    book, request = Book.of([(option, market)]), Request(np.array([1e-6]))
    times = np.linspace(3.0, 4.98, 50)
    found, lines = ENGINE.boundary(book, times, request), ObstacleMarch().boundary(book, times, request)
    both = ~np.isnan(found.near) & ~np.isnan(lines.near)
    assert np.sum(np.isnan(found.near) != np.isnan(lines.near)) <= 1
    assert 20 < both.sum() < 50
    wide = both & (found.near - found.far > 5.0)
    assert np.all(np.abs(found.near - lines.near)[wide] <= 2e-3 * STRIKE)
    assert np.all(np.abs(found.far - lines.far)[wide] <= 2e-3 * STRIKE)


def test_where_the_premium_is_negligible_the_value_is_the_european_one():
    option, market = Option("put", 100.0, 1.0), Market(100.0, -0.0100, 0.5, -0.01001)
    found = ENGINE.solve(Book.of([(option, market)]), Request(np.array([1e-6]), "extended"))
    assert found.value[0] == pytest.approx(found.european[0], abs=1e-9)
    assert 0.0 < found.error[0] <= 1e-7 * STRIKE
    assert math.isnan(found.boundary[0])
    european = price_many(
        {
            "option_type": "put",
            "exercise": "european",
            "spot": 100.0,
            "strike": 100.0,
            "expiry": 1.0,
            "rate": -0.01,
            "dividend_yield": -0.01001,
            "volatility": 0.5,
        },
        greeks="extended",
    )
    for name in ("delta", "gamma", "vega", "rho", "dividend_rho", "vanna", "volga", "charm", "theta"):
        assert getattr(found, name)[0] == pytest.approx(european[name][0], rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_greeks_hold_where_little_is_earned(tolerance):
    """The premium of such contracts is far below the tolerance, but its derivative by the rate is not."""
    random = np.random.default_rng(12)
    contracts = columns(300, 11)
    near = -(10.0 ** random.uniform(-9.0, -4.0, 300))
    far = near * (1.0 + 10.0 ** random.uniform(-2.0, 1.0, 300))
    is_put = contracts["option_type"] == "put"
    contracts |= {"rate": np.where(is_put, near, far), "dividend_yield": np.where(is_put, far, near)}
    found, fine = (
        price_many(contracts, tolerance=each, greeks="extended", greek_errors=True)
        for each in (tolerance, 1e-8)
    )
    assert set(found["method"]) == {"boundary-collocation"}
    waits = ~found["exercise_now"] & ~fine["exercise_now"]
    for greek in ("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "volga", "charm"):
        assert np.isfinite(found[greek]).all(), greek
        off = np.abs(found[greek] - fine[greek])[waits]
        stated = (found[f"{greek}_error"] + fine[f"{greek}_error"])[waits]
        assert np.mean(off <= stated + 1e-9) >= 0.95, greek


def test_an_interrupt_ends_the_work():
    book = Book.of([(PUT, MARKET)] * 3)
    found = ENGINE.solve(book, Request(np.full(3, 1e-6), interrupt=lambda: True))
    assert not found.settled.any()
    ends = ENGINE.boundary(
        Book.of([(PUT, MARKET)]), np.zeros(1), Request(np.array([1e-6]), interrupt=lambda: True)
    )
    assert not ends.found.any()
