"""Advice with a local volatility: flat and displaced cases, simulated paths, cost of waiting by a free density."""

import math

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    exercise_advice,
    exercise_boundary,
    price,
)
from pricing_core.american.advice.density_march import DensityMarch
from pricing_core.american.advice.region import Span
from pricing_core.american.book.book import Book
from tests.american.advice.monte_carlo import simulate
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

SPOTS = np.geomspace(20.0, 500.0, 120)
TWO = (CashDividend(0.25, 2.0), CashDividend(0.75, 2.0))


def skewed(time, spots):
    return (0.22 + 0.05 * time) * (spots / 100.0) ** -0.5


SKEW = LocalVolatility.from_function(skewed, np.linspace(0.0, 1.0, 9), SPOTS)
CASES = {
    "put at the money": (Option("put", 100.0, 1.0), Market(100.0, 0.05, SKEW)),
    "put out of the money": (Option("put", 90.0, 0.5), Market(110.0, 0.05, SKEW)),
    "put in the money": (Option("put", 110.0, 1.0), Market(95.0, 0.06, SKEW, 0.02)),
    "put with cash dividends": (Option("put", 100.0, 1.0), Market(95.0, 0.05, SKEW, 0.0, TWO)),
    "call with cash dividends": (Option("call", 95.0, 1.0), Market(105.0, 0.05, SKEW, 0.0, TWO)),
    "call with a yield": (Option("call", 100.0, 1.0), Market(100.0, 0.03, SKEW, 0.07)),
    "negative rate": (Option("call", 100.0, 1.0), Market(105.0, -0.03, SKEW, 0.01)),
    "two boundaries": (Option("put", 100.0, 1.0), Market(100.0, -0.01, SKEW.shifted(-0.08), -0.03)),
    "escrowed": (Option("call", 100.0, 1.0), Market(108.0, 0.05, SKEW, 0.0, TWO, dividend_model="escrowed")),
    "Bermudan": (Option("put", 100.0, 1.0, "bermudan", (0.25, 0.5, 0.75)), Market(95.0, 0.05, SKEW)),
}


@pytest.mark.parametrize("name", CASES)
def test_nobody_is_lost_and_time_only_adds(name):
    option, market = CASES[name]
    advice = exercise_advice(option, market, times=np.linspace(0.0, option.expiry, 11))
    total = advice.probability + advice.exercised_at_expiry + advice.expires_worthless
    assert total == pytest.approx(1.0, abs=1e-8)
    for column in (advice.cumulative_probability, advice.assignment_probability, advice.cost_of_waiting):
        assert (np.diff(column) >= -1e-9).all()
    assert advice.probability_error < 2e-3
    assert advice.exercised_at_expiry >= 0.0
    assert advice.expires_worthless >= 0.0


@pytest.mark.parametrize(
    ("option_type", "changes"),
    [
        ("put", {}),
        ("put", {"cash_dividends": TWO}),
        ("call", {"cash_dividends": TWO}),
        ("call", {"dividend_yield": 0.08}),
        ("put", {"rate": -0.02, "dividend_yield": -0.05}),
        ("call", {"cash_dividends": TWO, "dividend_model": "escrowed"}),
    ],
)
def test_a_constant_surface_gives_what_the_integral_equation_gives(option_type, changes):
    given = {"spot": 100.0, "rate": 0.05, "volatility": 0.2} | changes
    flat = LocalVolatility([0.0, 1.0], [50.0, 100.0, 200.0], np.full((2, 3), 0.2))
    option, times = Option(option_type, 100.0, 1.0), [0.1, 0.25, 0.5, 0.75, 0.9]
    expected = exercise_advice(option, Market(**given), times)
    found = exercise_advice(option, Market(**(given | {"volatility": flat})), times)
    allowed = expected.probability_error + found.probability_error
    assert allowed < 3e-3
    for name in ("probability", "exercised_at_expiry", "expires_worthless"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=min(allowed, 3e-4))
    difference = np.abs(found.cumulative_probability - expected.cumulative_probability)
    assert difference.max() < min(allowed, 3e-4)
    assert found.expected_time == pytest.approx(expected.expected_time, abs=1e-3)
    costs = np.abs(found.cost_of_waiting - expected.cost_of_waiting)
    assert (costs <= found.cost_error + expected.cost_error).all()


@pytest.mark.parametrize(("strike", "shift"), [(100.0, -30.0), (105.0, 40.0), (90.0, -20.0)])
def test_displaced_diffusion_is_exercised_when_the_flat_option_is(strike, shift):
    """sigma(F) = s (F + d)/F with q = r: F + d is lognormal, and the option that of the strike K + d."""
    s, rate = 0.25, 0.05
    nodes = np.geomspace(max(2.0, 1.05 * -shift), 2000.0, 400)
    local = LocalVolatility.from_function(lambda time, F: s * (F + shift) / F, [0.0], nodes)
    times = [0.1, 0.3, 0.5]
    found = exercise_advice(Option("put", strike, 0.5), Market(100.0, rate, local, rate), times)
    flat = Market(100.0 + shift, rate, s, rate)
    expected = exercise_advice(Option("put", strike + shift, 0.5), flat, times)
    allowed = found.probability_error + expected.probability_error
    assert allowed < 2e-3
    assert found.probability == pytest.approx(expected.probability, abs=min(allowed, 5e-4))
    difference = np.abs(found.cumulative_probability - expected.cumulative_probability)
    assert difference.max() < min(allowed, 5e-4)
    assert found.exercise_boundary == pytest.approx(expected.exercise_boundary - shift, rel=2e-4)


@pytest.mark.parametrize("name", ["put at the money", "put in the money", "call with a yield"])
def test_cost_of_waiting_is_the_multiplier_under_the_free_density(name):
    """Who does not exercise loses r K - q S (a put) per year as long as exercise is optimal: the premium, to expiry."""
    option, market = CASES[name]
    book = Book.of([(option, market)])
    (segment,), sign = book.segments_of(), 1.0 if option.is_put else -1.0
    times = option.expiry * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 65)) ** 2
    level = exercise_boundary(option, market, times).boundary / option.strike
    march, losses = DensityMarch(book, 64, 0.0, lambda: None), []
    s = march.nodes
    lost = sign * (segment.rate - segment.dividend_yield * s)
    edges = np.concatenate([s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]])
    for k, time in enumerate(times.tolist()):
        if k > 0:
            march.count = 4
            march.pass_through(segment, Span(times.item(k - 1), time))
        below = np.clip((level[k] - edges[:-1]) / np.diff(edges), 0.0, 1.0)
        inside = below if option.is_put else 1.0 - below
        losses.append(math.exp(-segment.rate * time) * float(march.mass @ (inside * lost)))
    found = option.strike * np.trapezoid(losses, times)
    assert march.mass.sum() == pytest.approx(1.0, abs=1e-10)
    premium = price(option, market).early_exercise_premium
    assert found == pytest.approx(premium, rel=5e-3)


def compare(name, paths, steps):
    option, market = CASES[name]
    advice = exercise_advice(option, market, times=np.linspace(0.0, option.expiry, 6))
    simulated = simulate(option, market, paths, steps, seed=len(name))

    def close(found, expected):
        deviation = math.sqrt(max(expected * (1.0 - expected), 1e-4) / paths)
        assert abs(found - expected) <= 4.0 * deviation + advice.probability_error

    close(advice.probability, simulated.probability)
    close(advice.exercised_at_expiry, simulated.at_expiry)
    close(advice.expires_worthless, simulated.worthless)
    for time, found in zip(advice.time.tolist(), advice.cumulative_probability.tolist(), strict=True):
        close(found, simulated.cumulative(time))


def test_probabilities_are_those_of_simulated_paths():
    compare("put at the money", 40_000, 60)


@pytest.mark.nightly
@pytest.mark.parametrize("name", CASES)
def test_probabilities_are_those_of_many_simulated_paths(name):
    compare(name, 400_000, 200)
