"""Puts whose cash dividends take most of the spot, or all of it: what is left has no forward to speak of."""

import numpy as np
import pytest

from pricing_core.american import price_many
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel


def put(random, life):
    """Return a put whose dividends are together as large as the spot, or larger."""
    expiry, count = random.uniform(*life), int(random.integers(5, 14))
    times = np.sort(random.uniform(0.0, expiry, count))
    spot = 100.0 * np.exp(random.normal(0.0, 0.4))
    amounts = random.dirichlet(np.ones(count)) * random.uniform(0.8, 2.0) * spot
    return {
        "option_type": "put",
        "spot": spot,
        "strike": 100.0,
        "expiry": expiry,
        "rate": random.uniform(0.01, 0.09),
        "dividend_yield": random.uniform(0.0, 0.08),
        "volatility": np.exp(random.uniform(np.log(0.1), np.log(0.8))),
        "cash_dividends": [
            {"time": time, "amount": amount} for time, amount in zip(times, amounts, strict=True)
        ],
    }


@pytest.mark.nightly
@pytest.mark.parametrize("life", [(0.2, 2.0), (2.0, 10.0)], ids=["short", "long"])
@pytest.mark.parametrize(
    ("tolerance", "count"),
    [(1e-4, 40), (1e-6, 40)],
)
def test_the_price_is_that_of_the_march_of_obstacle_problems(life, tolerance, count):
    random = np.random.default_rng(23)
    rows = [put(random, life) for _ in range(count)]
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    found = price_many(columns, tolerance=tolerance, greeks="none")
    fine = price_many(columns, tolerance=1e-6, greeks="none", method="lcs")
    served = np.array(found["method"]) == "multiplier-collocation"
    assert served.mean() > 0.5
    apart = np.abs(np.array(found["price"]) - np.array(fine["price"]))[served]
    allowed = (np.array(found["error_estimate"]) + np.array(fine["error_estimate"]))[served]
    assert np.mean(apart <= allowed) > 0.92
    assert np.all(apart <= 1e-3 + allowed)


@pytest.mark.parametrize("rate", [-0.03, -0.0035])
def test_rho_counts_every_discount_of_what_is_left_at_a_spot_of_zero(rate):
    dividends = [{"time": time, "amount": 0.4} for time in (0.7, 1.4, 2.9)]
    row = {"option_type": "put", "spot": 63.0, "strike": 100.0, "expiry": 3.4, "dividend_yield": 0.018}
    columns = {name: [value] for name, value in {**row, "volatility": 1.4}.items()} | {
        "cash_dividends": [dividends]
    }
    step, by_steps = 2e-4, []
    for by in (step, 2.0 * step):
        ends = [
            price_many({**columns, "rate": [rate + side * by]}, tolerance=1e-8, greeks="none")["price"][0]
            for side in (1.0, -1.0)
        ]
        by_steps.append((ends[0] - ends[1]) / (2.0 * by))
    wanted = (4.0 * by_steps[0] - by_steps[1]) / 3.0
    found = price_many({**columns, "rate": [rate]}, greeks="standard")
    assert found["method"][0] == "multiplier-collocation"
    assert found["rho"][0] == pytest.approx(wanted, abs=1e-4)
