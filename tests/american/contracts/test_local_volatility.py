"""Surfaces of local volatility: interpolation between the nodes, how they are made and seen, and what is refused."""

import pickle
import re
from itertools import pairwise

import numpy as np
import pytest

from pricing_core.american import LocalVolatility, Market, Option
from pricing_core.american.contracts.local_volatility import hat_weights, mean_weights, read_volatility
from pricing_core.american.contracts.seen_later import seen_later
from pricing_core.errors import InvalidInputError

SEEDS = range(20)


def random_surface(rng):
    """Return a surface with uneven axes."""
    times = np.cumsum(rng.uniform(0.01, 0.5, rng.integers(1, 8)))
    spots = 50.0 * np.exp(np.cumsum(rng.uniform(0.02, 0.4, rng.integers(1, 9))))
    return LocalVolatility(times, spots, rng.uniform(0.05, 0.9, (times.size, spots.size)))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_nodes_are_met_and_nothing_lies_beyond_them(seed):
    rng = np.random.default_rng(seed)
    surface = random_surface(rng)
    for time, row in zip(surface.times, surface.values, strict=True):
        np.testing.assert_allclose(surface.at(time, surface.spots), row, rtol=1e-12)
        for (low, high), (left, right) in zip(pairwise(surface.spots), pairwise(row), strict=True):
            between = surface.at(time, np.geomspace(low, high, 40))
            assert np.all(np.diff(between) * np.sign(right - left) >= -1e-14)  # monotone
    outside = surface.at(surface.times[0], np.array([0.0, 1e-20, 1e20]))
    np.testing.assert_allclose(outside, surface.values[0][[0, 0, -1]], rtol=1e-12)
    for time, row in ((0.0, 0), (1e3, -1)):
        np.testing.assert_allclose(surface.at(time, surface.spots), surface.values[row], rtol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_variance_is_linear_in_time(seed):
    rng = np.random.default_rng(seed)
    surface = random_surface(rng)
    spots = rng.uniform(40.0, 300.0, 10)
    for early, late in pairwise(surface.times):
        share = rng.uniform()
        expected = (1.0 - share) * surface.at(early, spots) ** 2 + share * surface.at(late, spots) ** 2
        found = surface.at((1.0 - share) * early + share * late, spots)
        np.testing.assert_allclose(found**2, expected, rtol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_means_over_intervals_are_those_of_the_interpolant(seed):
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(0.05, 1.0, rng.integers(1, 7)))
    starts = rng.uniform(0.0, 4.0, 12)
    ends = starts + rng.uniform(1e-6, 2.0, 12)
    values = rng.uniform(0.0, 1.0, nodes.size)
    found = mean_weights(nodes, starts, ends) @ values
    for start, end, mean in zip(starts, ends, found, strict=True):
        middles = start + (end - start) * (np.arange(20_000) + 0.5) / 20_000
        assert mean == pytest.approx(np.interp(middles, nodes, values).mean(), abs=1e-8)
    np.testing.assert_allclose(hat_weights(nodes, ends) @ values, np.interp(ends, nodes, values), atol=1e-14)


def test_the_cubic_is_of_high_order_where_the_function_is_monotone():
    def skew(time, spots):
        return 0.2 * np.sqrt(1.0 + time) * (spots / 100.0) ** -0.4

    errors = []
    for nodes in (12, 24, 48):
        surface = LocalVolatility.from_function(skew, [0.0, 0.5], np.geomspace(40.0, 250.0, nodes))
        spots = np.linspace(60.0, 180.0, 301)
        errors.append(np.abs(surface.at(0.5, spots) - skew(0.5, spots)).max())
    assert errors[1] < errors[0] / 6.0
    assert errors[2] < errors[1] / 6.0


def test_forward_moneyness_moves_with_the_forward():
    market = Market(100.0, {"times": [0.5, 1.0], "values": [0.1, 0.02]}, 0.3, dividend_yield=0.03)
    k, times = np.linspace(-0.6, 0.6, 13), np.array([0.25, 0.75, 2.0])
    values = 0.2 + 0.1 * times[:, None] - 0.1 * k
    surface = LocalVolatility.from_forward_moneyness(times, k, values, market)
    growth = [0.07 * 0.25, 0.07 * 0.5 - 0.01 * 0.25, 0.07 * 0.5 - 0.01 * 1.5]
    for time, by, row in zip(times, growth, values, strict=True):
        found = surface.at(time, 100.0 * np.exp(k + by))
        np.testing.assert_allclose(found, row, rtol=1e-9)


def test_a_later_time_and_a_moved_or_shifted_surface_are_seen_as_they_are():
    surface = random_surface(np.random.default_rng(3))
    spots, later = surface.spots, float(surface.times[-1]) * 0.6
    seen = surface.seen_from(later)
    for time in (0.0, 0.1, 5.0):
        np.testing.assert_allclose(seen.at(time, spots), surface.at(later + time, spots), rtol=1e-12)
    np.testing.assert_allclose(surface.moved(1.1).at(0.3, 1.1 * spots), surface.at(0.3, spots), rtol=1e-12)
    np.testing.assert_allclose(surface.shifted(0.1).values, surface.values + 0.1)
    _, market = seen_later(Option("put", 100.0, 1.0), Market(100.0, 0.05, surface), 0.5)
    assert market.volatility == surface.seen_from(0.5)


def test_surfaces_are_values():
    surface = random_surface(np.random.default_rng(1))
    other = LocalVolatility(surface.times.tolist(), surface.spots.tolist(), surface.values.tolist())
    assert surface == other
    assert hash(surface) == hash(other)
    assert surface != surface.moved(2.0)
    assert surface != 0.2
    copied = pickle.loads(pickle.dumps(surface))
    assert copied == surface
    assert copied.at(0.1, 100.0) == surface.at(0.1, 100.0)
    with pytest.raises(ValueError, match="read-only"):
        surface.values[0, 0] = 1.0
    assert (
        read_volatility({name: getattr(surface, name).tolist() for name in ("times", "spots", "values")})
        == surface
    )


GIVEN = {"times": [0.0, 1.0], "spots": [90.0, 110.0], "values": [[0.2, 0.3], [0.2, 0.3]]}


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"values": [[0.2, 0.3], [0.2]]}, "volatility.values[1]"),
        ({"values": [[0.2, 0.3]]}, "volatility.values"),
        ({"values": [[0.2, -0.3], [0.2, 0.3]]}, "volatility.values[0][1]"),
        ({"values": [[0.2, float("nan")], [0.2, 0.3]]}, "volatility.values[0][1]"),
        ({"values": [[0.2, 0.3], [15.1, 0.3]]}, "volatility.values[1][0]"),
        ({"values": [[0.2, None], [0.2, 0.3]]}, "volatility.values"),
        ({"values": [[True, False], [True, True]]}, "volatility.values"),
        ({"values": "0.2"}, "volatility.values"),
        ({"values": 0.2}, "volatility.values"),
        ({"times": [1.0, 0.0]}, "volatility.times"),
        ({"times": [-0.1, 1.0]}, "volatility.times[0]"),
        ({"times": []}, "volatility.times"),
        ({"times": [0.0, float("inf")]}, "volatility.times[1]"),
        ({"spots": [110.0, 90.0]}, "volatility.spots"),
        ({"spots": [100.0, 100.0]}, "volatility.spots"),
        ({"spots": [0.0, 90.0]}, "volatility.spots[0]"),
        ({"spots": ["a", "b"]}, "volatility.spots"),
        ({"spots": np.linspace(1.0, 2.0, 1001).tolist()}, "volatility.spots"),
        (
            {"times": np.arange(1000.0), "spots": np.arange(1.0, 1001.0), "values": np.zeros((1000, 1000))},
            "volatility.values",
        ),
    ],
)
def test_what_is_no_surface_is_refused_by_name(changes, field):
    with pytest.raises(InvalidInputError, match=re.escape(field)) as raised:
        Market(100.0, 0.05, GIVEN | changes)
    assert raised.value.field == field


def test_a_mapping_with_other_keys_is_refused():
    with pytest.raises(InvalidInputError, match="volatility"):
        Market(100.0, 0.05, {"times": [0.0], "spots": [1.0]})


def test_a_surface_of_a_hundred_million_numbers_is_refused_before_it_is_copied():
    axis, values = np.arange(1.0, 10_001.0), np.broadcast_to(0.2, (10_000, 10_000))
    for times, spots in ((axis, axis), ([0.0], [100.0])):
        with pytest.raises(InvalidInputError, match="numbers") as raised:
            LocalVolatility(times, spots, values)
        assert raised.value.field in ("times", "values")
