"""Observed orders of convergence: one row per method."""

import math

import numpy as np
import pytest

from pricing_core.american import Market, Option, Resolution, price

OPTION, MARKET = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.25, 0.05)
TRUE = 9.462492596167 + 0.106952702747  # European + premium: Andersen, Lake, Offengenden 2016, table 2

# (resolution at the coarsest level, least order over four doublings, largest error at the finest, fraction of strike)
ROWS = {
    "implicit Euler, square-root mesh": (Resolution(50, 12, scheme="implicit-euler"), 0.85, 1.5e-4),
    "SDIRK2, square-root mesh": (Resolution(50, 12), 1.9, 1e-6),
    "SDIRK2, square-root mesh, stretched grid": (Resolution(50, 12, stretching=2.0), 1.9, 1.5e-7),
    "SDIRK2, uniform mesh": (Resolution(50, 12, time_mesh="uniform"), 1.9, 5e-7),
    "SDIRK2, adaptive mesh": (Resolution(50, 12, time_mesh="adaptive"), 1.9, 1e-6),
    "Crank-Nicolson": (Resolution(50, 12, scheme="crank-nicolson"), 1.9, 1e-6),
}
DOUBLINGS = 4


@pytest.mark.parametrize("name", ROWS)
def test_order_of_convergence(name):
    resolution, least_order, largest_error = ROWS[name]
    errors = []
    for _ in range(DOUBLINGS + 1):
        valuation = price(OPTION, MARKET, resolution=resolution, greeks="none")
        errors.append(abs(valuation.price - TRUE) / OPTION.strike)
        resolution = resolution.refined()
    slope = np.polyfit(range(DOUBLINGS + 1), np.log2(errors), 1)[0]
    assert -slope >= least_order, errors
    assert errors[-1] <= largest_error


def test_error_estimate_at_a_fixed_resolution_follows_the_error():
    """A constant would fail: both fall by about four with every doubling."""
    resolution = Resolution(50, 12)
    ratios, estimates = [], []
    for _ in range(4):
        valuation = price(OPTION, MARKET, resolution=resolution, greeks="none")
        estimates.append(valuation.error_estimate)
        ratios.append(valuation.error_estimate / abs(valuation.price - TRUE))
        resolution = resolution.refined()
    assert all(0.5 <= ratio <= 30 for ratio in ratios)
    assert estimates[-1] < 0.2 * estimates[0]


def test_step_size_control_takes_small_steps_at_expiry_only():
    """The boundary leaves the strike like sqrt(tau): the controller finds that out by itself."""
    valuation = price(OPTION, MARKET, resolution=Resolution(200, 50, time_mesh="adaptive"), greeks="none")
    steps = valuation.diagnostics.steps_taken
    assert 20 <= steps <= 200
    assert math.isclose(valuation.price, TRUE, abs_tol=2e-3)
