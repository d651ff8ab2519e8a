import math

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.flat.exercise_region import exercise_region, never_exercised, region_at_expiry
from pricing_core.american.flat.tridiagonal_step import OptionState

NODES = np.linspace(-1.0, 1.0, 41)


def state(slack):
    contact = slack == 0.0
    return OptionState(slack[None, :], slack, contact, np.zeros(slack.size), 0.0)


def discrete_parabola(boundary, direction=1):
    """What the grid makes of J (x - x_f)**2/2: that parabola, lowered so that it vanishes at the last contact node."""
    s = direction * (NODES - boundary)
    nearest = np.argmin(np.abs(s))
    lowered = s**2 - s[nearest] ** 2
    return np.where(direction * (NODES - NODES[nearest]) > 0, np.maximum(lowered, 0.0), 0.0)


@pytest.mark.parametrize("boundary", [-0.3, -0.29, -0.2801, -0.27])
def test_boundary_between_nodes_is_the_vertex(boundary):
    found = exercise_region(state(discrete_parabola(boundary)), NODES, True, False)
    assert found.lower == -math.inf
    assert found.upper == pytest.approx(boundary, abs=1e-9)


@pytest.mark.parametrize("boundary", [0.3, 0.31, 0.3199])
def test_boundary_of_a_call_is_found_from_the_other_side(boundary):
    found = exercise_region(state(discrete_parabola(boundary, -1)), NODES, False, True)
    assert found.upper == math.inf
    assert found.lower == pytest.approx(boundary, abs=1e-9)


def test_two_boundaries_and_none():
    both = np.where(NODES < 0, discrete_parabola(-0.22, -1), discrete_parabola(0.33))
    found = exercise_region(state(both), NODES, False, False)
    assert (found.lower, found.upper) == (pytest.approx(-0.22, abs=1e-9), pytest.approx(0.33, abs=1e-9))
    nowhere = exercise_region(state(np.ones(41)), NODES, False, False)
    assert not nowhere.contains(0.0)
    assert all(math.isnan(end) for end in nowhere.boundaries(Option("put", 100.0, 1.0)))


@pytest.mark.parametrize(
    ("option_type", "rate", "dividend_yield", "expected"),
    [
        ("put", 0.05, 0.0, (100.0, None)),
        ("put", 0.03, 0.06, (50.0, None)),
        ("put", -0.02, -0.04, (100.0, 50.0)),
        ("put", 0.0, -0.04, None),
        ("call", 0.06, 0.03, (200.0, None)),
        ("call", 0.0, 0.03, (100.0, None)),
        ("call", -0.04, -0.02, (100.0, 200.0)),
    ],
)
def test_limits_at_expiry(option_type, rate, dividend_yield, expected):
    """K min(1, r/q) and K max(1, r/q); [K r/q, K] for q < r < 0 and [K, K r/q] for r < q < 0."""
    option, market = Option(option_type, 100.0, 1.0), Market(100.0, rate, 0.2, dividend_yield)
    near, far = region_at_expiry(option, market).boundaries(option)
    if expected is None:
        assert near == pytest.approx(100.0)
        return
    assert near == pytest.approx(expected[0])
    assert math.isnan(far) if expected[1] is None else far == pytest.approx(expected[1])


@pytest.mark.parametrize("rate", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("dividend_yield", [-0.02, 0.0, 0.02])
def test_never_exercised_by_the_sign_of_the_rates(rate, dividend_yield):
    market = Market(100.0, rate, 0.2, dividend_yield)
    assert never_exercised(Option("put", 1.0, 1.0), market) == (rate <= 0 and rate <= dividend_yield)
    assert never_exercised(Option("call", 1.0, 1.0), market) == (
        dividend_yield <= 0 and dividend_yield <= rate
    )
