"""Derivatives by the march transposed and by tangents: each other, closed forms, the option engine, differences."""

import numpy as np
import pytest
from scipy.stats import norm

from pricing_core.american import Market, Option, price
from pricing_core.errors import InvalidInputError, UnknownNameError
from pricing_core.obstacle import Event, Obstacle, solve
from pricing_core.obstacle.adjoint import Walk
from pricing_core.obstacle.direction import changed, neighbours
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.march import march
from pricing_core.obstacle.tangent import tangent
from tests.obstacle.problems import PUT, callable_put, option

SMOOTH_PUT = Obstacle(lambda x: 1.0 - np.exp(x))  # the value is above 0 of itself
DIVIDEND = Event(0.4, move=lambda x: np.log(np.maximum(np.exp(x) - 0.03, 1e-9)), cash=0.01)
PROBLEMS = {
    "european": option(PUT, american=False),
    "american": option(PUT, lower=SMOOTH_PUT),
    "american with an event": option(PUT, lower=SMOOTH_PUT, events=[DIVIDEND]),
    "bermudan": option(PUT, lower=Obstacle(SMOOTH_PUT.value, at=[0.3, 0.6])),
    "window": option(PUT, lower=Obstacle(SMOOTH_PUT.value, during=(0.5, 1.0))),
    "callable": callable_put(),
}
DIRECTIONS = {
    "volatility": {"volatility": 1.0},
    "volatility by place and time": {"volatility": lambda x, t: np.sin(3.0 * x) * (1.0 + t)},
    "drift": {"drift": 1.0},
    "rate": {"rate": 1.0},
    "several": {"rate": 1.0, "drift": 1.0, "volatility": -0.5},
    "source": {"source": lambda x: np.exp(-(x**2))},
    "payoff and obstacle": {"payoff": lambda x: 0.1 * np.exp(x), "lower": lambda x: 0.1 * np.exp(x)},
    "cash": {"cash": 1.0},
}
X = 0.05


# Where the payoff is 0 the callable put has two derivatives, one for each sign of the change.
CASES = [
    (name, direction)
    for name, problem in PROBLEMS.items()
    for direction, change in DIRECTIONS.items()
    if ("lower" not in change or problem.lower is not None)
    and ("cash" not in change or problem.events)
    and not (name == "callable" and direction in ("source", "payoff and obstacle"))
]


@pytest.mark.parametrize(("name", "direction"), CASES)
def test_the_walk_back_is_the_derivative_of_the_march(name, direction):
    """Central differences of the march itself: 1e-6 where a node enters the contact set between them."""
    problem, change = PROBLEMS[name], DIRECTIONS[direction]
    grid = Grid.of(choose_map(problem, np.array([X])), 4)
    found = Walk.of(march(problem, grid), X).derivative(neighbours(problem, change))
    size = 2e-5
    high, low = (
        float(march(changed(problem, change, sign * size), grid).now(np.array([X]))[0])
        for sign in (1.0, -1.0)
    )
    assert found == pytest.approx((high - low) / (2.0 * size), abs=3e-5)


@pytest.mark.parametrize(("name", "direction"), CASES)
def test_the_tangent_forward_and_the_walk_back_agree_to_rounding(name, direction):
    problem, change = PROBLEMS[name], DIRECTIONS[direction]
    found = march(problem, Grid.of(choose_map(problem, np.array([X])), 4))
    (forward,) = tangent(found, neighbours(found.problem, change), np.array([X]))[0]
    assert forward == pytest.approx(Walk.of(found, X).derivative(neighbours(found.problem, change)), abs=1e-9)


def test_mixed_derivatives_of_a_european_put_are_those_of_black_and_scholes():
    r, sigma = 0.05, 0.2
    x = np.array([-0.2, 0.0, 0.3])
    by_volatility = {"volatility": 1.0, "drift": -sigma}
    solution = solve(option(PUT, american=False, rate=r, volatility=sigma, expiry=1.0), x, 1e-6)
    found = solution.tangent(**by_volatility)
    d1 = (x + (r + sigma**2 / 2.0)) / sigma
    d2 = d1 - sigma
    vega = np.exp(x) * norm.pdf(d1)
    assert (np.abs(found.value - vega) <= found.error_estimate + 1e-9).all()
    assert (np.abs(found.slope + np.exp(x) * norm.pdf(d1) * d2 / sigma) <= found.slope_error_estimate).all()
    assert found.slope_error_estimate.max() < 5e-4
    volga = solution.second_derivative(by_volatility, by_volatility)
    bent = solution.derivative(drift=-1.0).value  # the drift of ln S is not linear in the volatility
    missed = np.abs(volga.value + bent - vega * d1 * d2 / sigma)
    assert (missed <= volga.error_estimate + 5e-5).all()


def test_mixed_derivatives_of_an_american_put_are_those_of_the_option_engine():
    spots = np.array([0.85, 1.0, 1.2])
    by_volatility = {"volatility": 1.0, "drift": -0.2}
    solution = solve(option(PUT), np.log(spots), 1e-6)
    found = solution.tangent(**by_volatility)
    volga, bent = solution.second_derivative(by_volatility, by_volatility), solution.derivative(drift=-1.0)
    for k, spot in enumerate(spots):
        greeks = price(Option("put", 1.0, 1.0), Market(spot, 0.05, 0.2), tolerance=1e-7, greeks="extended")
        assert found.slope[k] / spot == pytest.approx(greeks.vanna, abs=found.slope_error_estimate[k])
        assert volga.value[k] + bent.value[k] == pytest.approx(
            greeks.volga, abs=volga.error_estimate[k] + 1e-3
        )
    assert found.slope_error_estimate.max() < 2e-3
    assert volga.error_estimate.max() < 0.1


def test_at_one_place_derivatives_are_numbers():
    solution = solve(option(PUT), 0.1, 1e-4)
    found = solution.tangent(rate=1.0)
    assert isinstance(found.value, float)
    assert isinstance(found.curvature_error_estimate, float)
    assert found.value == pytest.approx(solution.derivative(rate=1.0).value, abs=1e-9)
    assert isinstance(solution.second_derivative({"rate": 1.0}, {"drift": 1.0}).value, float)


def test_a_european_puts_derivatives_are_those_of_black_and_scholes():
    r, sigma, T = 0.05, 0.2, 1.0
    x = np.array([-0.2, 0.0, 0.3])
    solution = solve(option(PUT, american=False, rate=r, volatility=sigma, expiry=T), x, 1e-7)
    d1 = (x + (r + sigma**2 / 2.0) * T) / sigma
    vega = np.exp(x) * norm.pdf(d1) * np.sqrt(T)
    rho = -T * np.exp(-r * T) * norm.cdf(sigma * np.sqrt(T) - d1)
    by_volatility = solution.derivative(volatility=1.0, drift=-sigma)  # the drift of ln S is r - sigma^2/2
    by_rate = solution.derivative(rate=1.0, drift=1.0)
    assert (np.abs(by_volatility.value - vega) <= by_volatility.error_estimate + 1e-9).all()
    assert (np.abs(by_rate.value - rho) <= by_rate.error_estimate + 1e-9).all()
    assert by_volatility.error_estimate.max() < 1e-5


def test_an_american_puts_derivatives_are_those_of_the_option_engine():
    spots = np.array([0.85, 1.0, 1.2])
    solution = solve(option(PUT), np.log(spots), 1e-7)
    vega, rho = solution.derivative(volatility=1.0, drift=-0.2), solution.derivative(rate=1.0, drift=1.0)
    for k, spot in enumerate(spots):
        greeks = price(Option("put", 1.0, 1.0), Market(spot, 0.05, 0.2), tolerance=1e-7, greeks="standard")
        assert vega.value[k] == pytest.approx(greeks.vega, abs=vega.error_estimate[k] + 2e-6)
        assert rho.value[k] == pytest.approx(greeks.rho, abs=rho.error_estimate[k] + 2e-6)
    assert max(vega.error_estimate.max(), rho.error_estimate.max()) < 2e-4


def test_cash_is_worth_its_discounted_amount():
    problem = option(PUT, american=False, events=[Event(0.5, cash=0.1), Event(1.0, cash=0.2)])
    solution = solve(problem, 0.0, 1e-6)
    assert solution.derivative(cash=[1.0, 0.0]).value == pytest.approx(np.exp(-0.025), abs=1e-9)
    assert solution.derivative(cash=[0.0, 1.0]).value == pytest.approx(np.exp(-0.05), abs=1e-9)


def test_in_a_contact_set_the_value_goes_with_its_obstacle():
    solution = solve(option(PUT), np.log(0.7), 1e-6)
    assert solution.derivative(lower=1.0).value == pytest.approx(1.0, abs=1e-9)
    assert solution.derivative(volatility=1.0).value == 0.0


def test_what_is_no_direction_is_refused():
    solution = solve(option(PUT, american=False), 0.0, 1e-4)
    with pytest.raises(UnknownNameError, match="'vol'"):
        solution.derivative(vol=1.0)
    with pytest.raises(
        InvalidInputError, match=r"lower = 1.0: must be left out: the problem has no lower obstacle"
    ):
        solution.derivative(lower=1.0)
    for asked in (
        solution.derivative,
        solution.tangent,
        lambda: solution.second_derivative({"rate": 1.0}, {}),
    ):
        with pytest.raises(InvalidInputError, match="direction = nothing: must be one or several of"):
            asked()


@pytest.mark.parametrize("refined", [2, 8])
def test_a_derivative_hardly_depends_on_how_far_the_neighbours_lie(refined):
    """An error in the square of their distance that each stage adds anew grows with the number of stages."""
    problem, x = option(PUT, lower=SMOOTH_PUT), np.array([0.02])
    own = march(problem, Grid.of(choose_map(problem, x), refined))
    near, far = (
        tangent(own, neighbours(problem, {"volatility": 1.0}, size), x)[0, 0] for size in (1e-5, 1e-3)
    )
    assert far == pytest.approx(near, abs=2e-5)
