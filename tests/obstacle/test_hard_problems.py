"""Problems on which estimates were too low, or what was told was wrong: coefficients that oscillate, grids that are not
resolved, payoffs at the ends, drifts that outrun the diffusion; what holds on dates and at events."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from pricing_core.errors import InvalidInputError
from pricing_core.obstacle import Diffusion, Event, Obstacle, ObstacleProblem, as_lcs, nodal_method, solve
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.march import march
from tests.obstacle.problems import CALL, PRICES, PUT, option


def lognormal_call(x, deviation, rate_to_expiry=0.0):
    d = (x + rate_to_expiry) / deviation + deviation / 2.0
    return np.exp(x) * norm.cdf(d) - np.exp(-rate_to_expiry) * norm.cdf(d - deviation)


@pytest.mark.parametrize("speed", [4.0, 6.0, 7.0, 2.0 * np.pi])
def test_a_volatility_that_oscillates_is_as_good_as_its_mean_variance(speed):
    def volatility(x, t):
        return np.full(x.shape, 0.2 * (1.0 + 0.9 * np.sin(speed * t)))

    diffusion = Diffusion(volatility, lambda x, t: -0.5 * volatility(x, t) ** 2, 0.0)
    solution = solve(ObstacleProblem(diffusion, CALL, 2.0, ends=PRICES), 0.02, tolerance=1e-4)
    variance = quad(lambda t: float(volatility(np.zeros(1), t)[0]) ** 2, 0.0, 2.0, limit=400)[0]
    assert solution.status == "ok"
    assert abs(solution.value - lognormal_call(0.02, np.sqrt(variance))) <= solution.error_estimate


def test_a_rate_that_oscillates_faster_than_the_steps_is_stepped_as_often():
    problem = ObstacleProblem(
        Diffusion(0.2, 0.0, lambda x, t: 0.05 + 0.5 * np.cos(64.0 * np.pi * t)), Obstacle(1.0), 2.0
    )
    solution = solve(problem, 0.0, tolerance=1e-2)
    assert abs(solution.value - np.exp(-0.1)) <= solution.error_estimate


def test_a_rate_that_depends_on_the_place_keeps_the_order():
    problem = ObstacleProblem(Diffusion(0.2, 0.0, lambda x: x), Obstacle(1.0), 1.0)
    x = np.array([0.05])
    chosen = choose_map(problem, x)
    values = [march(problem, Grid.of(chosen, size)).now(x)[0] for size in (1, 2, 4, 8)]
    changes = np.abs(np.diff(values))
    assert (changes[:-1] / changes[1:] > 7.0).all()


def test_grids_on_which_the_problem_blows_up_leave_the_best_value_before_them():
    """Cox, Ingersoll and Ross 1985; functions are asked inside the interval alone."""
    diffusion = Diffusion(lambda x: 0.1 * np.sqrt(x), lambda x: 0.5 * (0.06 - x), lambda x: x)
    problem = ObstacleProblem(diffusion, Obstacle(1.0), 10.0, interval=(1e-4, 1.0))
    solution = solve(problem, 0.05, tolerance=1e-6)
    assert abs(solution.value - 0.564233) <= solution.error_estimate + 1e-6
    assert solution.error_estimate < 1e-4


@pytest.mark.parametrize("x", [-1.1, -1.05])
def test_what_lies_far_away_but_is_large_counts(x):
    payoff = Obstacle(lambda x: 1e6 * (x > 0.0), kinks=[0.0])
    solution = solve(ObstacleProblem(Diffusion(0.2, 0.0, 0.0), payoff, 1.0), x, tolerance=1e-3)
    assert abs(solution.value - 1e6 * norm.cdf(x / 0.2)) <= solution.error_estimate


@pytest.mark.parametrize(
    ("volatility", "rate", "expiry", "x", "tolerance"),
    [
        (0.01, 1.0, 1.0, -1.0, 1e-6),
        (0.00542, -0.1757, 1.76, 0.33924, 5.3e-3),
        (0.00325, -0.13, 0.19, 0.028, 1e-5),
    ],
)
def test_a_drift_that_outruns_the_diffusion_has_an_honest_estimate(volatility, rate, expiry, x, tolerance):
    diffusion = Diffusion(volatility, rate - volatility**2 / 2.0, rate)
    solution = solve(ObstacleProblem(diffusion, CALL, expiry, ends=PRICES), x, tolerance)
    true = lognormal_call(x, volatility * np.sqrt(expiry), rate * expiry)
    assert abs(solution.value - true) <= solution.error_estimate


@pytest.mark.parametrize("rate", [-2.0, -20.0, -60.0])
def test_values_that_grow_by_many_powers_of_e_are_stepped_as_often(rate):
    """1 + a r must stay above 0 in every stage, or the values mean nothing."""
    problem = ObstacleProblem(Diffusion(0.2, 0.03, rate), PUT, 1.0, ends=PRICES)
    solution = solve(problem, 0.0, 1e-4 * np.exp(-rate))
    true = np.exp(-rate) * (norm.cdf(-0.15) - np.exp(0.05) * norm.cdf(-0.35))
    assert solution.status == "ok"
    assert abs(solution.value - true) <= solution.error_estimate


@pytest.mark.parametrize("volatilities", [(0.2, 0.1, 0.2), (0.3, 0.1, 0.15), (0.1, 0.4, 0.2)])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_a_first_estimate_of_two_grids_alone_is_not_kept(volatilities, tolerance):
    breaks = (0.25, 0.7)

    def volatility(x, t):
        return np.full(x.shape, volatilities[np.searchsorted(breaks, t, side="right")])

    diffusion = Diffusion(volatility, lambda x, t: 0.03 - volatility(x, t) ** 2 / 2.0, 0.05, breaks=breaks)
    solution = solve(ObstacleProblem(diffusion, CALL, 1.0, ends=PRICES), 0.0, tolerance)
    deviation = np.sqrt(np.dot(np.square(volatilities), [0.25, 0.45, 0.3]))
    true = np.exp(-0.02) * lognormal_call(0.0, deviation, 0.03)
    assert abs(solution.value - true) <= solution.error_estimate


def test_curvature_at_a_boundary_is_that_of_one_side():
    solution = solve(option(PUT, rate=1.0), 0.0, 1e-5)
    edge = solution.contact(0.0)[0][1]
    for x in (edge - 1e-6, edge, edge + 1e-6):
        near = solve(option(PUT, rate=1.0), x, 1e-5)
        sides = (-np.exp(x), (1.0 - np.exp(x) * 0.0) / 0.02 - np.exp(x))
        assert min(abs(near.curvature - side) / abs(side) for side in sides) < 0.05
        assert near.value >= 1.0 - np.exp(x) - 1e-15


def test_values_lie_between_obstacles_and_are_the_payoff_at_the_horizon():
    corridor = Obstacle(lambda x: PUT(x, 0.0) + 1e-3, kinks=[0.0])
    problem = option(PUT, upper=corridor)
    solution = solve(problem, 0.0, 1e-5)
    x = np.linspace(-0.3, 0.3, 201)
    for t in (0.0, 0.37, 0.9999):
        values = solution.values(t, x)[0]
        assert (values >= PUT(x, t)).all()
        assert (values <= corridor(x, t)).all()
    assert np.array_equal(solution.values(1.0, x)[0], PUT(x, 1.0))
    with pytest.raises(InvalidInputError, match=r"x = 30.0: must be inside the interval"):
        solution.values(0.0, 30.0)


def test_a_date_today_counts_and_dates_beyond_are_refused():
    now = solve(option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], at=[0.0])), np.array([-0.3, 0.2]))
    assert now.value[0] == 1.0 - np.exp(-0.3)
    assert now.slope[0] == pytest.approx(-np.exp(-0.3), abs=1e-6)
    assert now.value[1] > 0.0
    for date in (-0.1, 1.5):
        with pytest.raises(InvalidInputError, match=r"at = .*: must be from 0 to the horizon, 1"):
            option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], at=[date]))


def test_contact_sets_are_told_on_dates_and_just_before_events():
    dated = solve(option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], at=[0.5])), 0.0)
    ((left, right),) = dated.contact(0.5)
    assert left == -np.inf
    assert dated.values(np.nextafter(0.5, 0.0), right - 0.1)[0, 0] == pytest.approx(
        PUT(np.array([right - 0.1]), 0.5)[0]
    )
    assert dated.contact(0.4) == ()
    paid = solve(option(PUT, events=[Event(0.5, cash=0.02)]), 0.0)
    assert paid.contact(0.5) == ()  # the cash is worth waiting for
    window = solve(option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], during=(0.0, 0.5))), 0.0)
    assert window.contact(0.5)[0][0] == -np.inf


def test_the_chapters_road_refuses_what_it_does_not_know():
    put = option(PUT)
    for problem in (
        option(PUT, events=[Event(0.5, cash=0.1)]),
        option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], at=[0.5])),
    ):
        with pytest.raises(InvalidInputError, match="without what happens on the way"):
            nodal_method(problem, 50, (-1.0, 1.0))
    with pytest.raises(InvalidInputError, match="a pair with left < right"):
        as_lcs(put, 50, (1.0, -1.0))
    with pytest.raises(InvalidInputError, match=r"time = 2.0: must be from 0 to the horizon"):
        as_lcs(put, 50, (-1.0, 1.0), time=2.0)
    with pytest.raises(InvalidInputError, match="tableau"):
        nodal_method(put, 50, (-1.0, 1.0), tableau="Euler")


@pytest.mark.parametrize(
    "stated",
    [
        lambda: solve(ObstacleProblem(Diffusion(0.0, 0.0, 0.0), PUT, 1.0), 0.0),
        lambda: solve(option(PUT), 0.0, deadline="soon"),
        lambda: Obstacle(1.0, kinks=None),
        lambda: Obstacle(1.0, kinks=0.0),
        lambda: Obstacle(1.0, during=1.0),
        lambda: option(PUT, events=None),
        lambda: option(PUT, ends=(np.array([1.0, 2.0]), "linear")),
        lambda: as_lcs(option(PUT), 50, 5),
        lambda: solve(option(PUT), 0.0, 1e-3).derivative(cash=[1.0, 2.0]),
        lambda: solve(option(PUT), 0.0, 1e-3).second_derivative(1, 2),
        lambda: solve(ObstacleProblem(Diffusion(0.2, 0.0, lambda x: 1 / 0), PUT, 1.0), 0.0),
    ],
)
def test_whatever_is_given_the_error_is_the_librarys(stated):
    with pytest.raises(InvalidInputError):
        stated()


def test_a_function_in_a_direction_is_told_by_its_own_message():
    with pytest.raises(InvalidInputError, match=r"rate = nan at x = .*: must be finite"):
        solve(option(PUT), 0.0, 1e-3).derivative(rate=lambda x: x * np.nan)


def test_a_value_held_beyond_an_obstacle_is_the_obstacle():
    problem = ObstacleProblem(
        Diffusion(0.2, 0.0, 0.0),
        Obstacle(0.0),
        1.0,
        upper=Obstacle(0.5),
        interval=(-1.0, 1.0),
        ends=(3.0, "linear"),
    )
    solution = solve(problem, -0.9, tolerance=1e-3)
    assert solution.value <= 0.5


def test_a_second_derivative_by_an_obstacle_alone_is_taken():
    solution = solve(option(PUT), 0.1, 1e-4)
    assert np.isfinite(solution.second_derivative({"rate": 1.0}, {"lower": 1.0}).value)
