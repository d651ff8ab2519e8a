import math

import numpy as np
import pytest
from scipy.stats import norm

from pricing_core.american import Market, Option, Resolution, price
from pricing_core.american.contracts.schedule import make_schedule
from pricing_core.american.engines.method_of_lines.grid import (
    FEWEST_CELLS,
    FURTHEST,
    Grid,
    SpotRange,
    even_stretching,
    natural_stretching,
    reach,
)
from pricing_core.errors import InvalidInputError

RANGE = SpotRange(math.exp(-0.8), math.exp(1.5), 0.0, 0.3)
TRUNCATION = 1e-8


def range_of(market, option_type="put", expiry=1.0, start=1.0):
    schedule = make_schedule(Option(option_type, 100.0, expiry), market)
    return reach(schedule, TRUNCATION).range_of(start, start)


def test_without_stretching_the_nodes_are_equally_spaced_in_the_logarithm():
    assert np.diff(np.log(RANGE.grid(40, 0.0).nodes)) == pytest.approx(np.full(40, 2.3 / 40), rel=1e-12)
    shifted = RANGE.down_to_zero()
    assert np.diff(np.log(shifted.grid(40, 0.0).nodes + shifted.shift)).std() < 1e-12


def test_stretched_grids_are_finest_at_the_strike():
    nodes = np.log(RANGE.grid(60, 3.0).nodes)
    widths = np.diff(nodes)
    assert np.argmin(widths) == pytest.approx(np.searchsorted(nodes, 0.0), abs=1)
    assert widths.max() > 5 * widths.min()


@pytest.mark.parametrize("span", [RANGE, RANGE.down_to_zero()], ids=["above zero", "down to zero"])
@pytest.mark.parametrize("stretching", [0.0, 2.0])
def test_doubling_the_intervals_keeps_every_node(stretching, span):
    coarse, fine = (span.grid(n, stretching).nodes for n in (40, 80))
    assert fine[::2] == pytest.approx(coarse, abs=1e-12)
    assert 0.8 * span.low <= coarse[0] <= span.low * (1.0 + 1e-12)
    assert span.high * (1.0 - 1e-12) <= coarse[-1] <= 1.3 * span.high


@pytest.mark.parametrize("span", [RANGE, RANGE.down_to_zero()], ids=["above zero", "down to zero"])
@pytest.mark.parametrize("intervals", [8, 45, 64, 1000])
def test_the_strike_is_a_node_of_a_stretched_grid(span, intervals):
    assert np.abs(span.grid(intervals, 4.0).nodes - 1.0).min() < 1e-12


@pytest.mark.parametrize("seed", range(200))
def test_stretched_grids_go_little_further_than_asked_wherever_the_strike_lies(seed):
    rng = np.random.default_rng(seed)
    below, above = np.exp(
        rng.uniform(math.log(1e-12), math.log(300.0), 2)
    )  # distances of the ends in ln(S/K)
    intervals, stretching = int(rng.choice([8, 48, 64, 1024])), rng.uniform(0.1, 8.0)
    nodes = SpotRange(math.exp(-below), math.exp(above), 0.0, 0.3).grid(intervals, stretching).nodes
    assert np.all(np.diff(nodes) > 0.0)
    assert nodes[0] <= math.exp(-below) * (1.0 + 1e-12)
    assert math.exp(above) * (1.0 - 1e-12) <= nodes[-1]
    beyond = np.count_nonzero(nodes < math.exp(-below)) + np.count_nonzero(nodes > math.exp(above))
    assert beyond <= 2 * max(1, intervals // FEWEST_CELLS)  # two of the coarsest cells


def test_grids_for_boundaries_are_stretched_where_they_are_wide():
    assert even_stretching(0.5) == 0.0
    assert 0.0 < even_stretching(0.6) < even_stretching(3.0) < natural_stretching(3.0)


@pytest.mark.parametrize(("rate", "dividend_yield"), [(0.05, 0.0), (0.0, 0.2), (-0.1, 0.05), (0.3, -0.1)])
@pytest.mark.parametrize("expiry", [0.01, 1.0, 5.0])
def test_the_spot_leaves_the_range_with_a_negligible_chance(rate, dividend_yield, expiry):
    """At expiry under both measures, and on the way from 1: that of a Brownian motion is at most twice as much."""
    volatility = 0.3
    span = range_of(Market(100.0, rate, volatility, dividend_yield), expiry=expiry)
    spread = volatility * math.sqrt(expiry)
    for drift in (-0.5, 0.5):  # the pricing measure and that of the stock
        mean = (rate - dividend_yield) * expiry + drift * volatility**2 * expiry
        for start in (0.0, mean):
            assert 2.0 * norm.cdf((math.log(span.low) - start) / spread) < TRUNCATION
            assert 2.0 * norm.sf((math.log(span.high) - start) / spread) < TRUNCATION


def test_dividends_lower_the_range_and_may_take_it_to_zero():
    flat = range_of(Market(100.0, 0.05, 0.2))
    small, large = (
        range_of(Market(100.0, 0.05, 0.2, cash_dividends=[{"time": 0.5, "amount": amount}]))
        for amount in (2.0, 30.0)
    )
    assert small.low == pytest.approx(flat.low - 0.02)
    assert (small.high, small.shift, flat.shift) == (flat.high, 0.0, 0.0)
    assert (large.low, large.shift) == (0.0, pytest.approx(0.5 * flat.low))
    fraction = [{"time": 0.5, "fraction": 0.1}]
    assert range_of(Market(100.0, 0.05, 0.2, proportional_dividends=fraction)).low == pytest.approx(
        0.9 * flat.low
    )
    gone = [{"time": 0.5, "fraction": 1.0}]
    assert range_of(Market(100.0, 0.05, 0.2, proportional_dividends=gone)).low == 0.0
    escrowed = Market(
        100.0, 0.05, 0.2, cash_dividends=[{"time": 0.5, "amount": 30.0}], dividend_model="escrowed"
    )
    assert range_of(escrowed) == flat  # what diffuses does not drop


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_a_wider_range_does_not_change_the_price(option_type):
    """The ends neglect a hundredth of the tolerance."""
    option, market = Option(option_type, 100.0, 1.0), Market(100.0, 0.04, 0.3, 0.05)
    loose, tight = (price(option, market, tolerance=t, resolution=Resolution(800, 100)) for t in (1e-4, 1e-8))
    assert loose.price == pytest.approx(tight.price, abs=2e-4)


def test_extreme_contracts_stay_within_the_range_of_floating_point_numbers():
    span = range_of(Market(100.0, 0.01, 15.0), expiry=200.0)
    assert math.exp(-FURTHEST) <= span.low + span.shift < span.high <= math.exp(FURTHEST)
    nodes = span.grid(100, natural_stretching(span.spread)).nodes
    assert np.isfinite(nodes).all()
    assert np.all(np.diff(nodes) > 0.0)


@pytest.mark.parametrize("nodes", [[0.0, 1.0], [0.0, 1.0, 1.0], [2.0, 1.0, 0.0]])
def test_grids_must_increase(nodes):
    with pytest.raises(InvalidInputError, match="nodes"):
        Grid(np.array(nodes))
