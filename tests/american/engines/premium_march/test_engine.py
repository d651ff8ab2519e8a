import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from pricing_core.american.engines.premium_march import PremiumMarch
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
ENGINE = PremiumMarch()
PUT, FLAT = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.25, 0.01)
LATER = {"times": [2.0, 3.0], "values": [0.05, 0.07]}  # changes after expiry alone


@pytest.mark.parametrize(
    ("option", "market", "served"),
    [
        (PUT, FLAT, True),
        (Option("call", 100.0, 1.0), FLAT, True),
        (PUT, Market(100.0, LATER, 0.25), True),
        (Option("put", 100.0, 1.0, "european"), FLAT, False),
        (Option("put", 100.0, 1.0, exercise_start=0.5), FLAT, False),
        (Option("put", 100.0, 1.0, "bermudan", (0.5, 1.0)), FLAT, False),
        (PUT, Market(100.0, 0.05, 0.25, cash_dividends=[{"time": 0.5, "amount": 1.0}]), False),
        (PUT, Market(100.0, 0.05, 0.25, cash_dividends=[{"time": 1.0, "amount": 1.0}]), False),
        (PUT, Market(100.0, 0.05, 0.25, proportional_dividends=[{"time": 1.0, "fraction": 0.1}]), False),
        (PUT, Market(100.0, {"times": [0.5, 1.0], "values": [0.05, 0.07]}, 0.25), False),
        (PUT, Market(0.0, 0.05, 0.25), False),
        (PUT, Market(100.0, 0.05, 0.0), False),
        (PUT, Market(100.0, 0.05, 1e-10), False),
    ],
)
def test_american_contracts_without_events_are_served(option, market, served):
    assert ENGINE.serves(Book.of([(option, market)])).tolist() == [served]
    assert ENGINE.serves(Book.of([(PUT, FLAT), (option, market), (PUT, FLAT)])).tolist() == [
        True,
        served,
        True,
    ]


def test_without_the_kernel_nothing_is_served(monkeypatch):
    monkeypatch.setattr(kernel, "price_options", None)
    assert ENGINE.serves(Book.of([(PUT, FLAT)] * 2)).tolist() == [False, False]


def test_what_the_march_gives_up_is_not_settled():
    two_boundaries = Market(90.0, -0.02, 0.2, -0.05)
    lost = Option("put", 100.0, 2.0), Market(60.9, 0.15515858795, 0.0813951507, 1.5)
    found = solved(ENGINE, (PUT, FLAT), (PUT, two_boundaries), lost, tolerance=1e-3)
    assert found.settled.tolist() == [True, False, False]
    assert np.isnan(found.error).tolist() == [False, True, True]
    book = Book.of([(PUT, two_boundaries)])
    ends = ENGINE.boundary(book, Request(np.array([1e-6])))(np.array([0.0, 0.5]))
    assert not ends.found.any()
    assert np.isnan(ends.near).all()


def test_none_of_the_derivatives_by_parameters_unless_asked_for():
    without, standard, extended = (
        solved(ENGINE, (PUT, FLAT), greeks=g) for g in ("none", "standard", "extended")
    )
    for name in ("vega", "rho", "dividend_rho"):
        assert math.isnan(getattr(without, name)[0])
        assert getattr(standard, name)[0] == getattr(extended, name)[0]
    assert math.isnan(standard.vanna[0])
    assert np.isfinite(extended.vanna[0] + extended.volga[0])
    assert without.complete[0]
    assert standard.complete[0]
    assert extended.complete[0]


def test_a_curve_of_one_piece_up_to_expiry_has_that_bucket_alone():
    found = solved(ENGINE, (PUT, Market(100.0, LATER, 0.25, 0.01)), (PUT, FLAT), greeks="extended")
    assert found.rate_buckets.row(0) == (found.rho[0], 0.0)
    assert found.rate_buckets.row(1) == found.volatility_buckets.row(0) == ()
    assert found.complete.all()


def test_buckets_of_pieces_that_rounding_alone_keeps_apart_are_left_to_others():
    """A knot so close to now that it makes no segment: the piece before it holds at no time that counts."""
    curve = {"times": [1e-14, 1.0], "values": [0.06, 0.05]}
    found = solved(ENGINE, (PUT, Market(100.0, curve, 0.25, 0.01)), greeks="extended")
    assert not found.complete[0]
    assert np.isnan(found.rate_buckets.row(0)).all()


def test_contracts_that_share_a_march_have_the_same_prices():
    contracts = [(PUT, Market(spot, 0.05, 0.25, 0.01)) for spot in (90.0, 100.0, 110.0, 60.0)]
    book = Book.of(contracts)
    alone = ENGINE.solve(book, Request(np.full(4, 1e-5)))
    shared = ENGINE.solve(book, Request(np.full(4, 1e-5), share_solves=True))
    for name in ("value", "error", "delta", "gamma", "vega", "boundary"):
        assert getattr(alone, name).tobytes() == getattr(shared, name).tobytes(), name


@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_boundaries_are_within_their_stated_errors(option_type, tolerance):
    option, market = Option(option_type, 100.0, 2.0), Market(100.0, 0.04, 0.3, 0.06)
    book, times = Book.of([(option, market)]), np.array([0.0, 0.3, 1.0, 1.9, 1.999])
    found, best = (ENGINE.boundary(book, Request(np.array([t])))(times) for t in (tolerance, 1e-8))
    assert found.found.all()
    assert np.isnan(found.far).all()
    assert np.all(np.abs(found.near - best.near) <= found.error + best.error)
    assert np.all(found.error <= 0.1 * math.sqrt(tolerance) * found.near)
    limit = ENGINE.boundary(book, Request(np.array([1e-6])))(np.array([2.0]))
    assert limit.near[0] == pytest.approx(100.0 * (2.0 / 3.0 if option_type == "put" else 1.0), rel=1e-12)
    assert limit.error[0] == 0.0


def test_a_contract_cut_where_nothing_happens_is_not_served():
    cut = with_cuts(Book.of([(PUT, FLAT)]), Ragged.of([(0.5,)]))
    assert not ENGINE.serves(cut)[0]


def test_a_time_beyond_the_march_costs_itself_alone():
    """Far from expiry this put is beyond the march; close to it, it is not."""
    book = Book.of([(Option("put", 100.0, 35.0), Market(100.0, 0.05, 3.0))])
    found = ENGINE.boundary(book, Request(np.array([1e-6])))(np.array([0.0, 0.5, 0.9999]) * 35.0)
    assert found.found.tolist() == [False, True, True]


@pytest.mark.parametrize("earned_by", ["put", "call"])
def test_contracts_that_earn_by_one_rate_alone_are_marched(earned_by):
    """A put at r = 0 and q < 0, or a call at q = 0 and r < 0, against the general march; one boundary each."""
    random = np.random.default_rng(23)
    costs = -np.exp(random.uniform(math.log(1e-4), math.log(0.15), 20))
    contracts = []
    for cost, spot in zip(costs, 100.0 * np.exp(random.normal(0.0, 0.2, 20)), strict=True):
        rate, dividend_yield = (0.0, cost) if earned_by == "put" else (cost, 0.0)
        option = Option(earned_by, 100.0, math.exp(random.uniform(math.log(0.02), math.log(8.0))))
        contracts.append((option, Market(spot, rate, random.uniform(0.05, 0.8), dividend_yield)))
    marched = solved(ENGINE, *contracts, tolerance=1e-6)
    other = solved(ObstacleMarch(), *contracts, tolerance=1e-6)
    assert marched.settled.all()
    assert (marched.error <= 1e-6 * 100.0).all()
    apart = np.abs(marched.value - other.value) / (marched.error + other.error)
    assert np.max(apart, initial=0.0, where=~marched.exercised) <= 1.0
    np.testing.assert_allclose(marched.delta, other.delta, atol=1e-5)


def test_nothing_leaps_where_the_rate_crosses_zero_towards_one_boundary():
    rates = np.array([0.0, 1e-12, 1e-9, 1e-6, 1e-4])
    contracts = [(PUT, Market(95.0, rate, 0.25, -0.03)) for rate in rates]
    found = solved(ENGINE, *contracts, tolerance=1e-8, greeks="standard")
    assert found.settled.all()
    assert np.diff(found.value) == pytest.approx(found.rho[0] * np.diff(rates), abs=2e-6)
    assert np.ptp(found.steps) <= found.steps[0]


def test_the_price_does_not_depend_on_the_greeks_that_are_asked_for():
    """Greeks may need a finer march than the price, whose figures stay those of the march that met the tolerance."""
    random = np.random.default_rng(29)
    contracts = [
        (
            Option(
                random.choice(["put", "call"]),
                100.0,
                math.exp(random.uniform(math.log(0.01), math.log(10.0))),
            ),
            Market(
                100.0 * math.exp(random.normal(0.0, 0.25)),
                random.uniform(-0.02, 0.12),
                random.uniform(0.05, 1.0),
                random.uniform(-0.02, 0.15),
            ),
        )
        for _ in range(2000)
    ]
    book = Book.of(contracts)
    finer = 0
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-7):
        alone, standard, extended = (
            ENGINE.solve(book, Request(np.full(book.count, tolerance), greeks))
            for greeks in ("none", "standard", "extended")
        )
        for found in (standard, extended):
            for name in ("value", "european", "error", "boundary", "exercised", "settled"):
                np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), err_msg=name)
        finer += np.sum(standard.gamma[alone.settled] != alone.gamma[alone.settled])
    assert finer > 100


def flat_book(seed, count):
    """Return contracts from hours to ten years, every fifth with the rate next to the yield."""
    rng = np.random.default_rng(seed)
    contracts = []
    for k in range(count):
        expiry, volatility = (
            float(np.exp(rng.uniform(np.log(1e-3), np.log(10.0)))),
            float(rng.uniform(0.05, 1.0)),
        )
        rate = float(rng.uniform(0.001, 0.15))
        dividend_yield = max(rate + 1e-4 * rng.normal(), 0.0) if k % 5 == 0 else float(rng.uniform(0.0, 0.15))
        spot = 100.0 * math.exp(
            float(np.clip(rng.uniform(-3.0, 3.0) * volatility * math.sqrt(expiry), -3.0, 3.0))
        )
        option = Option(str(rng.choice(["put", "call"])), 100.0, expiry)
        contracts.append((option, Market(spot, rate, volatility, dividend_yield)))
    return Book.of(contracts)


def test_the_errors_of_greeks_are_honest():
    book = flat_book(5, 800)
    prices, exact = (
        ENGINE.solve(book, Request(np.full(book.count, tolerance), "standard")) for tolerance in (1e-6, 1e-8)
    )
    sure = prices.settled & exact.settled & ~prices.exercised & ~exact.exercised
    assert sure.mean() > 0.75
    for greek in ("delta", "gamma", "theta", "vega", "rho", "dividend_rho"):
        error = np.abs(getattr(prices, greek) - getattr(exact, greek))[sure]
        stated = (getattr(prices, error_of(greek)) + getattr(exact, error_of(greek)))[sure]
        assert np.mean(error <= stated) > 0.98, greek
        assert np.median(getattr(prices, error_of(greek))[sure]) < 60.0 * np.median(error), greek


@pytest.mark.parametrize(("greek", "of"), [("vanna", "delta"), ("volga", "vega"), ("charm", "delta")])
def test_second_order_greeks_are_differences_within_their_errors(greek, of):
    book = flat_book(6, 400)
    request, close = (Request(np.full(book.count, tolerance), "extended") for tolerance in (1e-6, 1e-8))
    prices = ENGINE.solve(book, request)
    base, sign = (book.segments.end, -1.0) if greek == "charm" else (book.segments.volatility, 1.0)
    found = []
    for share in (0.01, 0.005):
        column = "end" if greek == "charm" else "volatility"
        up, down = (
            ENGINE.solve(replace(book, segments=replace(book.segments, **{column: base * (1.0 + by)})), close)
            for by in (sign * share, -sign * share)
        )
        found.append((getattr(up, of) - getattr(down, of)) / (2.0 * share * base))
    wanted, doubt = found[1] + (found[1] - found[0]) / 3.0, np.abs(found[1] - found[0])
    sure = prices.settled & ~prices.exercised & np.isfinite(wanted)
    missed = np.abs(getattr(prices, greek) - wanted)[sure]
    assert np.mean(missed <= (getattr(prices, error_of(greek)) + doubt)[sure]) > 0.98
