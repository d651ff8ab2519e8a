"""Local volatilities by the march: against displaced diffusion, constant elasticity, curves and symmetry."""

import math

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american import LocalVolatility, Market, Option, PiecewiseConstant, exercise_boundary, price
from pricing_core.american.book.book import Book
from pricing_core.american.engines.closed_form import ClosedForm
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, ObstacleMarch
from pricing_core.american.engines.premium_march import PremiumMarch
from tests.problems.needs_kernel import needs_kernel
from tests.problems.nightly import nightly

SHIFTED = [(100.0, -30.0, 0.25, 0.05, 0.5), (110.0, -50.0, 0.5, 0.08, 1.0), (90.0, 40.0, 0.2, 0.03, 2.0)]


def displaced(forward, shift, volatility, nodes=200):
    """Return sigma(F) = s (F + d)/F as a surface."""
    spots = forward * np.exp(np.linspace(-3.0, 3.0, nodes))
    return LocalVolatility.from_function(
        lambda _, s: np.minimum(volatility * np.maximum(s + shift, 0.0) / s, 15.0), [0.0], spots
    )


def elastic(volatility, power, times=(0.0,), nodes=300):
    """Return s (S/100)^(power/2 - 1), cut at 3."""
    spots = np.geomspace(0.5, 2000.0, nodes)
    return LocalVolatility.from_function(
        lambda _, s: np.minimum(volatility * (s / 100.0) ** (power / 2.0 - 1.0), 3.0), times, spots
    )


@needs_kernel
@pytest.mark.parametrize("kind", ["put", "call"])
@pytest.mark.parametrize(("forward", "shift", "volatility", "rate", "expiry"), SHIFTED)
def test_displaced_diffusion_is_a_flat_option_moved(forward, shift, volatility, rate, expiry, kind):
    surface = displaced(forward, shift, volatility)
    market = Market(forward, rate, surface, dividend_yield=rate)
    found = price(Option(kind, 100.0, expiry), market, greeks="extended")
    moved = Market(forward + shift, rate, volatility, dividend_yield=rate)
    exact = price(Option(kind, 100.0 + shift, expiry), moved, tolerance=1e-8, greeks="extended")
    assert found.status == "ok"
    assert found.method == "obstacle-march"
    assert abs(found.price - exact.price) <= found.error_estimate
    for greek in ("delta", "gamma", "theta", "charm"):
        error = found.greek_errors[greek] + exact.greek_errors[greek]
        assert abs(getattr(found, greek) - getattr(exact, greek)) <= 2.0 * error + 2e-6, greek
    assert found.exercise_boundary + shift == pytest.approx(exact.exercise_boundary, rel=2e-3)


@needs_kernel
def test_displaced_diffusion_has_its_stated_values():
    for (forward, shift, volatility, rate, expiry), exact in zip(
        SHIFTED, (4.8320475, 6.1446248), strict=False
    ):
        market = Market(forward, rate, displaced(forward, shift, volatility), dividend_yield=rate)
        found = price(Option("put", 100.0, expiry), market, tolerance=1e-6)
        assert found.price == pytest.approx(exact, abs=5e-5)


@needs_kernel
@pytest.mark.parametrize("times", [(0.0,), tuple(np.linspace(0.0, 3.0, 7))])
@pytest.mark.parametrize(
    ("kind", "strike", "expiry", "rate", "dividend_yield", "volatility", "power", "value", "delta", "gamma"),
    [
        ("put", 100.0, 1.0, 0.05, 0.0, 0.2, 1.0, 6.0641414, -0.4284532, 0.0232249),
        ("put", 110.0, 1.0, 0.05, 0.0, 0.2, 0.0, 11.5950600, -0.7024764, 0.0275073),
        ("put", 100.0, 3.0, 0.07, 0.03, 0.3, 1.0, 14.8126073, -0.3954441, 0.0091555),
        ("call", 100.0, 1.0, 0.03, 0.07, 0.25, 1.0, 8.1989167, 0.4705872, 0.0171987),
    ],
)
def test_constant_elasticity_has_its_reference_values(
    times, kind, strike, expiry, rate, dividend_yield, volatility, power, value, delta, gamma
):
    market = Market(100.0, rate, elastic(volatility, power, times), dividend_yield)
    found = price(Option(kind, strike, expiry), market, tolerance=1e-7)
    assert found.price == pytest.approx(value, abs=1e-5)  # the tolerance
    assert found.delta == pytest.approx(delta, abs=2e-7)
    assert found.gamma == pytest.approx(gamma, abs=2e-7)
    assert abs(found.price - value) <= found.error_estimate


@needs_kernel
@pytest.mark.parametrize("seed", [0, 3, 6, *nightly(range(12))])
def test_a_constant_surface_is_a_flat_volatility(seed):
    rng = np.random.default_rng(seed)
    volatility, spot = rng.uniform(0.1, 0.6), rng.uniform(80.0, 120.0)
    surface = LocalVolatility([0.0, 0.4], [90.0, 110.0], np.full((2, 2), volatility))
    kind = rng.choice(["put", "call"])
    option = [
        Option(kind, 100.0, 1.0),
        Option(kind, 100.0, 1.0, "european"),
        Option(kind, 100.0, 1.0, "bermudan", (0.3, 0.7)),
        Option(kind, 100.0, 1.0, exercise_start=0.4),
    ][seed % 4]
    further = [
        {},
        {"cash_dividends": [{"time": 0.3, "amount": 3.0}, {"time": 0.8, "amount": 2.0}]},
        {"cash_dividends": [{"time": 0.5, "amount": 4.0}], "dividend_model": "escrowed"},
        {"proportional_dividends": [{"time": 0.6, "fraction": 0.04}]},
    ][rng.integers(4)]
    rates = (rng.uniform(0.0, 0.08), rng.uniform(0.0, 0.06))
    mine = price(option, Market(spot, rates[0], surface, rates[1], **further), greeks="extended")
    flat = price(option, Market(spot, rates[0], volatility, rates[1], **further), greeks="extended")
    assert abs(mine.price - flat.price) <= mine.error_estimate + flat.error_estimate
    assert mine.european_price == pytest.approx(flat.european_price, abs=1e-4)
    assert mine.delta_sticky_moneyness == pytest.approx(mine.delta, abs=1e-9)
    assert flat.delta_sticky_moneyness is None
    for greek in ("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "charm"):
        allowed = mine.greek_errors[greek] + flat.greek_errors.get(greek, 0.0)
        assert abs(getattr(mine, greek) - getattr(flat, greek)) <= 2.0 * allowed + 1e-6, greek


@needs_kernel
@pytest.mark.parametrize("exercise", ["american", "european"])
@pytest.mark.parametrize("spot", [90.0, 100.0])
def test_a_surface_of_time_alone_is_a_curve_of_volatilities(spot, exercise):
    times = np.array([0.0, 0.3, 0.5, 1.0])
    volatility = np.array([0.2, 0.5, 0.25, 0.4])
    surface = LocalVolatility(times, [80.0, 125.0], np.repeat(volatility[:, None], 2, axis=1))
    option = Option("put", 100.0, 1.0, exercise)
    found = price(option, Market(spot, 0.05, surface, 0.01))
    values = []
    for pieces in (40, 80):
        ends = np.arange(1, pieces + 1) / pieces
        means = [
            np.mean(np.interp((np.arange(200) + 0.5) / 200 / pieces + end - 1 / pieces, times, volatility**2))
            for end in ends
        ]
        curve = PiecewiseConstant(ends.tolist(), np.sqrt(means).tolist())
        values.append(price(option, Market(spot, 0.05, curve, 0.01), tolerance=1e-6).price)
    limit = values[1] + (values[1] - values[0]) / 3.0  # the pieces are of second order
    assert found.price == pytest.approx(limit, abs=5e-4 + found.error_estimate)


@needs_kernel
@pytest.mark.parametrize("seed", range(2))
def test_puts_and_calls_are_symmetric(seed):
    # C(S, K, r, q, sigma(t, s)) = P(K, S, q, r, sigma(t, S K/s)), American ones too (Carr and Chesney 1996).
    rng = np.random.default_rng(seed)
    spot, strike, rate, dividend_yield = (
        rng.uniform(90.0, 110.0, 2).tolist() + rng.uniform(0.01, 0.08, 2).tolist()
    )
    spots, times = np.geomspace(60.0, 160.0, 7), np.array([0.0, 0.4, 1.0])
    values = rng.uniform(0.15, 0.45, (3, 7))
    surface = LocalVolatility(times, spots, values)
    mirrored = LocalVolatility(times, (spot * strike / spots)[::-1], values[:, ::-1])
    call = price(Option("call", strike, 1.0), Market(spot, rate, surface, dividend_yield))
    put = price(Option("put", spot, 1.0), Market(strike, dividend_yield, mirrored, rate))
    assert abs(call.price - put.price) <= call.error_estimate + put.error_estimate


@needs_kernel
@pytest.mark.parametrize("seed", [0, *nightly(range(1, 6))])
def test_greeks_are_the_differences_of_prices(seed):
    rng = np.random.default_rng(seed)
    spots, times = np.geomspace(60.0, 160.0, 7), np.array([0.0, 0.4, 1.0])
    surface = LocalVolatility(
        times, spots, 0.25 - 0.2 * np.log(spots / 100.0) + rng.uniform(0.0, 0.05, (3, 1))
    )
    dividends = [{"time": 0.5, "amount": 3.0}] if seed % 2 else []
    option = Option("put" if seed % 3 else "call", 100.0, 1.0)

    def market(spot=98.0, rate=0.05, dividend_yield=0.02, volatility=surface, amount=3.0):
        paid = [d | {"amount": amount} for d in dividends]
        return Market(spot, rate, volatility, dividend_yield, cash_dividends=paid)

    def value(**changes):
        return price(option, market(**changes), tolerance=1e-6, greeks="none").price

    found = price(option, market(), tolerance=1e-6)
    wide = {
        "delta": (value(spot=98.2) - value(spot=97.8)) / 0.4,
        "delta_sticky_moneyness": (
            value(spot=98.2, volatility=surface.moved(98.2 / 98.0))
            - value(spot=97.8, volatility=surface.moved(97.8 / 98.0))
        )
        / 0.4,
        "rho": (value(rate=0.052) - value(rate=0.048)) / 0.004,
        "dividend_rho": (value(dividend_yield=0.022) - value(dividend_yield=0.018)) / 0.004,
        "vega": (value(volatility=surface.shifted(0.002)) - value(volatility=surface.shifted(-0.002)))
        / 0.004,
    }
    for name, expected in wide.items():
        assert getattr(found, name) == pytest.approx(expected, rel=2e-3, abs=2e-3), name
    if dividends:
        by_amount = (value(amount=3.1) - value(amount=2.9)) / 0.2
        assert found.dividend_sensitivities[0] == pytest.approx(by_amount, rel=2e-3, abs=1e-4)


@pytest.mark.nightly
@needs_kernel
def test_estimates_cover_the_errors_on_random_surfaces():
    covered = count = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        times = np.cumsum(rng.uniform(0.05, 0.6, rng.integers(1, 6)))
        spots = 100.0 * np.exp(np.sort(rng.uniform(-0.8, 0.8, 6)))
        surface = LocalVolatility(times, spots, rng.uniform(0.1, 0.6, (times.size, 6)))
        cash = [{"time": 0.4, "amount": rng.uniform(0.5, 5.0)}] if seed % 3 == 0 else []
        market = Market(100.0, rng.uniform(-0.01, 0.08), surface, rng.uniform(0.0, 0.05), cash_dividends=cash)
        option = Option(rng.choice(["put", "call"]), rng.uniform(80.0, 125.0), rng.uniform(0.2, 2.0))
        found = price(option, market, tolerance=1e-5, greeks="none")
        truth = price(option, market, tolerance=1e-6, greeks="none")
        count += 1
        covered += abs(found.price - truth.price) <= found.error_estimate + truth.error_estimate
    assert covered >= 0.95 * count


def few_nodes(rng):
    """Return a surface of few nodes whose values have nothing to do with each other."""
    times = np.cumsum(rng.uniform(0.01, 0.5, rng.integers(1, 8)))
    spots = 50.0 * np.exp(np.cumsum(rng.uniform(0.02, 0.4, rng.integers(1, 9))))
    return LocalVolatility(times, spots, rng.uniform(0.05, 0.9, (times.size, spots.size)))


def noise(rng):
    """Return a skew of many nodes with noise of 30 % at each."""
    times, spots = np.linspace(0.0, 1.5, rng.integers(2, 20)), np.geomspace(40.0, 250.0, rng.integers(10, 60))
    noisy = np.exp(0.3 * rng.normal(size=(times.size, spots.size)))
    return LocalVolatility(times, spots, 0.25 * (spots / 100.0) ** -0.5 * noisy)


@needs_kernel
@pytest.mark.nightly
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
@pytest.mark.parametrize("surface", [few_nodes, noise])
def test_estimates_cover_the_errors_on_rough_surfaces(surface, tolerance):
    rng = np.random.default_rng(21)
    contracts = []
    for _ in range(400):
        volatility = surface(rng)
        kind = "put" if rng.uniform() < 0.5 else "call"
        option = Option(kind, 100.0 * np.exp(rng.normal(0.0, 0.15)), rng.uniform(0.1, 1.5))
        contracts.append((option, Market(100.0, rng.uniform(0.0, 0.08), volatility, rng.uniform(0.0, 0.08))))
    book = Book.of(contracts)
    found, truth = (
        ObstacleMarch().solve(book, Request(np.full(book.count, each), "none"))
        for each in (tolerance, tolerance / 30.0)
    )
    covered = np.abs(found.value - truth.value) <= found.error + truth.error
    assert covered.mean() >= 0.98


def test_without_the_kernel_the_same_is_found(monkeypatch):
    surface = elastic(0.25, 1.0, (0.0, 0.5, 1.0), nodes=40)
    option = Option("put", 105.0, 1.0)
    market = Market(100.0, 0.05, surface, 0.01, cash_dividends=[{"time": 0.5, "amount": 2.0}])
    compiled = price(option, market, tolerance=1e-4)
    monkeypatch.setattr(kernel, "march_segments", None)
    found = price(option, market, tolerance=1e-4)
    assert abs(found.price - compiled.price) <= found.error_estimate + compiled.error_estimate
    for greek in ("delta", "vega", "rho", "delta_sticky_moneyness"):
        assert getattr(found, greek) == pytest.approx(getattr(compiled, greek), rel=5e-3, abs=1e-3), greek


def test_crank_nicolson_and_adaptive_steps_agree():
    surface = elastic(0.25, 1.0, (0.0, 0.5, 1.0), nodes=40)
    market, option = Market(100.0, 0.05, surface), Option("put", 100.0, 1.0)
    found = price(option, market, tolerance=1e-4, greeks="none")
    other = price(option, market, tolerance=1e-4, greeks="none", method="crank-nicolson")
    assert abs(found.price - other.price) <= found.error_estimate + other.error_estimate


@needs_kernel
def test_two_engines_serve_it():
    surface = elastic(0.25, 1.0)
    contracts = [
        (Option("put", 100.0, 1.0), Market(100.0, 0.05, surface)),
        (Option("call", 100.0, 1.0), Market(100.0, 0.05, surface)),
        (Option("put", 100.0, 1.0, "european"), Market(100.0, 0.05, surface)),
        (
            Option("put", 100.0, 1.0),
            Market(100.0, 0.05, surface, cash_dividends=[{"time": 0.5, "amount": 1.0}]),
        ),
    ]
    book = Book.of(contracts)
    for engine in (ClosedForm(), PremiumMarch()):
        assert not engine.serves(book).any()
    for engine in (CompiledMarch(), ObstacleMarch()):
        assert engine.serves(book).all()


@needs_kernel
def test_the_boundary_is_that_of_the_displaced_option():
    forward, shift, volatility, rate, expiry = SHIFTED[0]
    times = np.linspace(0.0, 0.9 * expiry, 6)
    option, surface = Option("put", 100.0, expiry), displaced(forward, shift, volatility)
    found = exercise_boundary(option, Market(forward, rate, surface, dividend_yield=rate), times=times)
    moved = Market(forward + shift, rate, volatility, dividend_yield=rate)
    exact = exercise_boundary(Option("put", 100.0 + shift, expiry), moved, times=times)
    np.testing.assert_allclose(found.boundary + shift, exact.boundary, rtol=1e-3)


def test_what_has_no_time_or_no_spot_needs_no_volatility():
    surface = elastic(0.25, 1.0)
    assert price(Option("put", 100.0, 0.0), Market(90.0, 0.05, surface)).price == 10.0
    worthless = price(Option("put", 100.0, 1.0, "european"), Market(0.0, 0.05, surface))
    assert worthless.price == pytest.approx(100.0 * math.exp(-0.05))
