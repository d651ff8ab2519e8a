"""Obstacles with kinks that hold the value: several of them, near each other or moving; and kinks in short segments."""

import numpy as np
import pytest

from pricing_core.obstacle import Diffusion, Event, Held, Obstacle, ObstacleProblem, nodal_method, solve
from pricing_core.obstacle.grid import Grid, grid_map
from pricing_core.stepping import SDIRK2, integrate
from pricing_core.stepping.controller import FixedStep
from tests.obstacle.problems import PRICES, PUT, option


def test_maps_with_places_on_nodes_never_turn_back():
    rng = np.random.default_rng(3)
    on_nodes = 0.0
    for _ in range(300):
        places = np.sort(rng.uniform(-0.5, 0.5, rng.integers(1, 6)))
        chosen = grid_map(-1.0, 1.2, 64, places, tuple(rng.random(2) < 0.5))
        widths = np.diff(Grid.of(chosen, 2).x)
        assert widths.min() > 0.25 * chosen.size
        assert widths.max() < chosen.size
        index = chosen.inverse(places)
        is_on = np.abs(index - np.round(index)) < 1e-8
        assert is_on[0] or chosen.spline is None
        on_nodes += is_on.mean() / 300.0
    assert on_nodes > 0.85


def test_a_corridor_with_four_kinks_that_hold_the_value():
    kinks = [-0.21, -0.05, 0.09, 0.23]

    def lower(x):
        return np.interp(x, [-3.0, *kinks, 3.0], [0.0, 0.1, 0.35, 0.38, 0.2, 0.0])

    corridor = Obstacle(lower, kinks=kinks), Obstacle(lambda x: lower(x) + 0.05, kinks=kinks)
    problem = ObstacleProblem(
        Diffusion(0.3, -0.02, 0.03), corridor[0], 0.7, lower=corridor[0], upper=corridor[1]
    )
    solution = solve(problem, 0.15, 1e-5)
    found = []
    for size in (1, 2):  # a nodal problem with all kinks on nodes, of second order
        method, state, x = nodal_method(problem, 370 * size - 1, (-1.8, 1.9), tableau=SDIRK2)
        run = integrate(method, state, (0.0, 0.7), controller=FixedStep(0.7 / (50 * size)))
        found.append(float(np.interp(0.15, x, run.states[-1].value)))
    true = found[1] + (found[1] - found[0]) / 3.0
    assert solution.status == "ok"
    assert abs(found[1] - found[0]) < 2e-5
    assert abs(solution.value - true) <= solution.error_estimate + abs(found[1] - found[0])
    assert solution.value > lower(0.15) + 0.02  # which a map that turns back makes of it


@pytest.mark.parametrize("growth", [-0.2, -0.05, 1e-9, 0.05, 0.2])
def test_a_cap_that_moves_is_seen_and_its_error_told(growth):
    """In the frame that goes with the cap its kink rests on a node."""

    def capped(x, t):
        return np.minimum(np.maximum(np.exp(x) - 1.0, 0.0), np.expm1(0.3 + growth * t))

    def in_its_frame(y, t):
        return capped(y + growth * t, t)

    def stated(obstacle, cap, strike, drift):
        payoff = Obstacle(lambda x: obstacle(x, 1.0), kinks=[strike(1.0), cap(1.0)])
        lower = Obstacle(obstacle, kinks=[strike, cap])
        return ObstacleProblem(Diffusion(0.25, drift, 0.05), payoff, 1.0, lower=lower, ends=PRICES)

    drift, at = 0.02 - 0.25**2 / 2.0, [0.1, 0.25]
    found = solve(stated(capped, lambda t: 0.3 + growth * t, lambda t: 0.0, drift), at, 1e-3)
    moving = Obstacle(in_its_frame, kinks=[lambda t: -growth * t, 0.3])
    true = solve(
        ObstacleProblem(
            Diffusion(0.25, drift - growth, 0.05),
            Obstacle(lambda y: in_its_frame(y, 1.0), kinks=[-growth, 0.3]),
            1.0,
            lower=moving,
            ends=PRICES,
        ),
        at,
        1e-6,
    )
    error = np.abs(found.value - true.value)
    assert (error <= found.error_estimate + true.error_estimate).all()
    assert (found.error_estimate < 0.02).all()
    assert (true.error_estimate <= 1e-6).all()


@pytest.mark.parametrize(("penalty", "true"), [(0.1085, 0.1257070)])
def test_a_put_that_is_called_only_just_before_now(penalty, true):
    """A nodal problem with the kink on a node, extrapolated: two resolutions agree to 2e-7."""
    upper = Obstacle(lambda x: PUT(x, 0.0) + penalty, kinks=[0.0])
    problem = ObstacleProblem(
        Diffusion(0.34, 0.063 - 0.34**2 / 2.0, 0.063), PUT, 1.0, lower=PUT, upper=upper, ends=PRICES
    )
    for tolerance in (1e-3, 1e-4, 1e-5):
        solution = solve(problem, -0.04, tolerance)
        assert abs(solution.value - true) <= solution.error_estimate + 2e-7


@pytest.mark.parametrize("length", [1e-8, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_a_window_of_seconds_to_hours_is_a_date_to_within_the_estimate(length, tolerance):
    """A window longer than a date is worth more, by no more than what is paid for exercising within it."""
    drift = 0.03
    window = Obstacle(PUT.value, kinks=[0.0], during=(0.5, 0.5 + length))
    dates = Obstacle(PUT.value, kinks=[0.0], at=[0.5, 0.5 + length])
    found, true = (
        solve(
            ObstacleProblem(Diffusion(0.2, drift, 0.05), PUT, 1.0, lower=lower, ends=PRICES), -0.1, accuracy
        )
        for lower, accuracy in ((window, tolerance), (dates, 1e-6))
    )
    more = 0.05 * length
    assert -found.error_estimate - true.error_estimate <= found.value - true.value
    assert found.value - true.value <= found.error_estimate + true.error_estimate + more


def test_a_kink_held_at_an_end_of_the_interval_lies_on_it():
    problem = option(PUT, interval=(-0.4, 0.5), ends=(Held(1.0 - np.exp(-0.4)), Held(0.0)))
    solution = solve(problem, 0.1, 1e-6)
    assert solution.status == "ok"
    assert solution.march.grid.x[0] == -0.4


def test_cash_on_a_date_on_which_obstacles_cross_is_refused_beforehand():
    crossing = {"lower": Obstacle(0.2, at=[0.5]), "upper": Obstacle(0.1, at=[0.5])}
    problem = ObstacleProblem(
        Diffusion(0.2, 0.0, 0.05), Obstacle(0.15), 1.0, events=[Event(0.7, cash=0.1)], **crossing
    )
    with pytest.raises(ValueError, match=r"lower = 0.2 at x = .*: must be at most upper, 0.1 there"):
        solve(problem, 0.0)
