"""Solutions to a tolerance: true values, honest estimates, contact sets, values over times, deadlines."""

import numpy as np
import pytest
from scipy.stats import ncx2, norm

from pricing_core.american import Market, Option, exercise_boundary, price
from pricing_core.errors import NumericalError
from pricing_core.obstacle import Diffusion, Event, Held, Obstacle, ObstacleProblem, solve
from tests.obstacle.problems import (
    AMERICAN_CAPPED_CALL,
    CALL,
    CALLABLE_PUT,
    CAP,
    PRICES,
    PUT,
    STRADDLE,
    callable_put,
    capped_call,
    option,
)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-6])
def test_a_value_lies_within_its_estimate_and_that_within_the_tolerance(tolerance):
    spots = np.array([0.7, 0.85, 1.0, 1.2, 1.5])
    true = [price(Option("put", 1.0, 1.0), Market(s, 0.05, 0.2), tolerance=1e-8).price for s in spots]
    solution = solve(option(PUT), np.log(spots), tolerance)
    assert solution.status == "ok"
    assert (solution.error_estimate <= tolerance).all()
    assert (np.abs(solution.value - true) <= solution.error_estimate + 1e-8).all()


def test_slope_and_curvature_are_those_of_the_price():
    spots = np.array([0.9, 1.0, 1.3])
    solution = solve(option(PUT), np.log(spots), 1e-6)
    for k, spot in enumerate(spots):
        greeks = price(Option("put", 1.0, 1.0), Market(spot, 0.05, 0.2), tolerance=1e-7, greeks="standard")
        delta = solution.slope[k] / spot
        assert delta == pytest.approx(greeks.delta, abs=3e-6)
        assert (solution.curvature[k] - solution.slope[k]) / spot**2 == pytest.approx(greeks.gamma, abs=2e-4)


def test_the_callable_put_and_the_capped_call_whose_kinks_hold_the_value():
    solution = solve(callable_put(), np.log([*CALLABLE_PUT]), 1e-6)
    error = np.abs(solution.value - [*CALLABLE_PUT.values()])
    assert (error <= solution.error_estimate + 1e-7).all()
    assert error.max() < 5e-7
    assert solution.upper_contact(0.4) == ((pytest.approx(0.0, abs=1e-12),) * 2,)
    assert solve(capped_call(), 0.0, 1e-7).value == pytest.approx(AMERICAN_CAPPED_CALL, abs=1e-7)
    (contact,) = solve(capped_call(), 0.0).contact(0.5)
    assert contact == (pytest.approx(np.log1p(CAP), abs=1e-12), np.inf)


def test_contact_sets_are_the_exercise_boundary():
    solution = solve(option(PUT), 0.0, 1e-6)
    boundary = exercise_boundary(Option("put", 1.0, 1.0), Market(1.0, 0.05, 0.2), tolerance=1e-6)
    for t in (0.0, 0.3, 0.7, 0.95):
        ((left, right),) = solution.contact(t)
        wanted = np.interp(t, boundary.time, boundary.boundary)
        assert left == -np.inf
        assert np.exp(right) == pytest.approx(wanted, abs=3e-4)
    assert solution.upper_contact(0.5) == ()


def test_a_straddle_has_two_contact_sets():
    solution = solve(option(STRADDLE, dividend_yield=0.08), 0.0, 1e-6)
    (down, up) = solution.contact(0.2)
    assert down[0] == -np.inf
    assert up[1] == np.inf
    assert down[1] < 0.0 < up[0]


def test_values_over_times_and_places():
    solution = solve(option(PUT), 0.0, 1e-6)
    spots, times = np.array([0.9, 1.1]), np.array([0.0, 0.5, 0.9])
    found = solution.values(times, np.log(spots))
    assert found.shape == (3, 2)
    for i, t in enumerate(times):
        for j, spot in enumerate(spots):
            true = price(Option("put", 1.0, 1.0 - t), Market(spot, 0.05, 0.2), tolerance=1e-7).price
            assert found[i, j] == pytest.approx(true, abs=2e-4)
    assert solution.values(1.0, np.log(spots))[0] == pytest.approx(np.maximum(1.0 - spots, 0.0), abs=1e-12)


def test_a_window_of_exercise_lies_between_european_and_american():
    window = option(PUT, lower=Obstacle(PUT.value, kinks=[0.0], during=(0.5, 1.0)))
    true = price(Option("put", 1.0, 1.0, exercise_start=0.5), Market(0.9, 0.05, 0.2), tolerance=1e-7).price
    assert solve(window, np.log(0.9), 1e-6).value == pytest.approx(true, abs=1e-6)


def test_a_local_volatility():
    """A European put with sigma(S) = 0.2 S^-0.5 against its closed form, by the non-central chi-square (Cox 1975)."""
    r, T, alpha, beta = 0.05, 1.0, 0.2, 0.5
    k = r / (alpha**2 * (1.0 - beta) * np.expm1(2.0 * r * (1.0 - beta) * T))
    x, y, nu = k * np.exp(2.0 * r * (1.0 - beta) * T), k, 1.0 / (2.0 * (1.0 - beta))
    call = ncx2.sf(2.0 * y, 2.0 + 2.0 * nu, 2.0 * x) - np.exp(-r * T) * ncx2.cdf(2.0 * x, 2.0 * nu, 2.0 * y)
    put = call - 1.0 + np.exp(-r * T)
    diffusion = Diffusion(
        lambda x: alpha * np.exp((beta - 1.0) * x),
        lambda x: r - 0.5 * alpha**2 * np.exp(2.0 * (beta - 1.0) * x),
        r,
    )
    solution = solve(ObstacleProblem(diffusion, PUT, T, ends=PRICES), 0.0, 1e-6)
    assert solution.value == pytest.approx(put, abs=2e-6)


@pytest.mark.parametrize(("early", "late"), [(0.1, 0.3), (0.9, 0.08), (0.08, 0.9)])
def test_coefficients_may_jump_at_breaks(early, late):
    """Black and Scholes with the mean variance and the mean rate; nine tenths of it may lie in either part."""
    middle, rates = 0.4, (0.02, 0.06)

    def jumps(first, second):
        return lambda x, t: first if t < middle else second

    diffusion = Diffusion(
        jumps(early, late),
        jumps(rates[0] - early**2 / 2.0, rates[1] - late**2 / 2.0),
        jumps(*rates),
        breaks=[middle],
    )
    variance = middle * early**2 + (1.0 - middle) * late**2
    rate = middle * rates[0] + (1.0 - middle) * rates[1]
    true = price(
        Option("put", 1.0, 1.0, exercise="european"), Market(1.0, rate, np.sqrt(variance)), tolerance=1e-8
    ).price
    solution = solve(ObstacleProblem(diffusion, PUT, 1.0, ends=PRICES), 0.0, 1e-6)
    assert solution.status == "ok"
    assert abs(solution.value - true) <= solution.error_estimate + 1e-8


def test_coupons_are_paid_and_moves_are_made_in_their_order():
    """A bond that pays 0.1 at 0.5 and at the horizon, in a rate that does not move."""
    bond = ObstacleProblem(
        Diffusion(0.1, 0.0, 0.05), Obstacle(1.0), 1.0, events=[Event(0.5, cash=0.1), Event(1.0, cash=0.1)]
    )
    true = 0.1 * np.exp(-0.025) + 1.1 * np.exp(-0.05)
    assert solve(bond, 0.3, 1e-7).value == pytest.approx(true, abs=1e-9)
    moved = ObstacleProblem(
        Diffusion(0.1, 0.0, 0.0),
        Obstacle(lambda x: x),
        1.0,
        events=[Event(0.5, move=lambda x: 2.0 * x), Event(0.5, move=lambda x: x + 1.0)],
    )
    assert solve(moved, 0.3, 1e-7).value == pytest.approx(1.6, abs=1e-9)  # x -> 2 x -> 2 x + 1


def test_a_running_cost_with_an_upper_and_a_lower_obstacle_that_meet():
    both = Obstacle(lambda x: 0.5 * x)
    pinned = ObstacleProblem(Diffusion(0.3, 0.1, 0.05), both, 1.0, lower=both, upper=both, source=-0.2)
    solution = solve(pinned, [0.2, -0.4], 1e-7)
    assert np.allclose(solution.value, [0.1, -0.2], rtol=0.0, atol=1e-12)


def test_a_knock_out_pays_its_rebate():
    """At the barrier the value is the rebate; just inside it is near it."""
    problem = option(CALL, american=False, interval=(None, 0.3), ends=("exponential", Held(0.05)))
    solution = solve(problem, [0.3, 0.2999], 1e-6)
    assert solution.value[0] == pytest.approx(0.05, abs=1e-12)
    assert solution.value[1] == pytest.approx(0.05, abs=2e-4)


def test_a_tolerance_out_of_reach_is_told_with_the_best_value():
    jump = Obstacle(lambda x: np.where(x < 0.1234, 1.0, 0.0))  # a step that no kink tells of
    solution = solve(ObstacleProblem(Diffusion(0.2, 0.0, 0.0), jump, 1.0), 0.0, 1e-12)
    assert solution.status == "tolerance_not_met"
    assert abs(solution.value - norm.cdf(0.1234 / 0.2)) <= solution.error_estimate


def test_a_deadline_ends_the_work():
    solution = solve(option(PUT), 0.0, 1e-12, deadline=1e-9)
    assert solution.status == "deadline"
    assert np.isnan(solution.value)
    with pytest.raises(NumericalError, match="no grid was finished, status 'deadline'"):
        solution.contact(0.5)


def test_where_no_stage_settles_there_is_no_value(monkeypatch):
    monkeypatch.setattr("pricing_core.obstacle.stage.MOST_ITERATIONS", 1)
    solution = solve(option(PUT), 0.0, 1e-5)
    assert solution.status == "tolerance_not_met"
    assert np.isnan(solution.value)


@pytest.mark.parametrize(
    ("market", "option_", "problem"),
    [
        (Market(1.0, 0.05, 0.2), Option("put", 1.0, 1 / 8760), option(PUT, expiry=1 / 8760)),
        (Market(1.0, 0.05, 0.001), Option("put", 1.0, 1.0), option(PUT, volatility=0.001)),
        (Market(0.9, 0.5, 0.02), Option("put", 1.0, 2.0), option(PUT, rate=0.5, volatility=0.02, expiry=2.0)),
        (
            Market(1.0, -0.3, 0.05, dividend_yield=0.2),
            Option("put", 1.0, 1.0),
            option(PUT, rate=-0.3, dividend_yield=0.2, volatility=0.05),
        ),
        (
            Market(1.0, 0.05, 2.0, dividend_yield=0.02),
            Option("put", 1.0, 25.0),
            option(PUT, dividend_yield=0.02, volatility=2.0, expiry=25.0),
        ),
        (
            Market(1.0, 0.05, 2.0, dividend_yield=0.02),
            Option("call", 1.0, 25.0),
            option(CALL, dividend_yield=0.02, volatility=2.0, expiry=25.0),
        ),
    ],
    ids=[
        "an hour",
        "hardly any diffusion",
        "drift",
        "negative rate",
        "sigma sqrt(T) of 10",
        "a call with sigma sqrt(T) of 10",
    ],
)
def test_extreme_numbers(market, option_, problem):
    true = price(option_, market, tolerance=1e-7)
    solution = solve(problem, np.log(market.spot), 3e-5)
    assert solution.status == "ok"
    assert abs(solution.value - true.price) <= solution.error_estimate + 1e-6


def test_events_minutes_apart_in_segments_that_the_grid_does_not_resolve():
    times = [0.3, 0.3 + 1e-6, 0.3 + 2e-6, 0.6]
    market = Market(1.0, 0.05, 0.2, cash_dividends=[(t, 0.01) for t in times])
    events = [Event(t, move=lambda x: np.log(np.maximum(np.exp(x) - 0.01, 1e-9))) for t in times]
    true = price(Option("put", 1.0, 1.0), market, tolerance=1e-7)
    solution = solve(option(PUT, events=events), 0.0, 1e-5)
    assert abs(solution.value - true.price) <= solution.error_estimate + 1e-6


def test_a_volatility_that_changes_smoothly_with_the_time():
    """Seasonal, and 30 times larger at one end than at the other."""
    for form in (lambda t: 0.2 + 0.1 * np.sin(7.0 * t), lambda t: 0.02 * np.exp(3.4 * t)):
        times = (np.arange(20_000) + 0.5) / 20_000
        deviation = float(np.sqrt(np.mean(form(times) ** 2)))
        diffusion = Diffusion(
            lambda x, t, form=form: form(t), lambda x, t, form=form: 0.05 - form(t) ** 2 / 2.0, 0.05
        )
        true = price(
            Option("put", 1.0, 1.0, exercise="european"), Market(1.05, 0.05, deviation), tolerance=1e-8
        ).price
        solution = solve(ObstacleProblem(diffusion, PUT, 1.0, ends=PRICES), np.log(1.05), 1e-6)
        assert abs(solution.value - true) <= solution.error_estimate + 1e-8


def test_next_to_a_contact_set_the_curvature_is_that_of_the_free_side():
    """There V leaves the obstacle as a parabola, D (V - lower)_xx = c: in S the gamma is (r K - q S)/(D S^2)."""
    r, volatility = 0.06, 0.2
    problem = option(
        PUT, rate=r, volatility=volatility, events=[Event(0.5, lambda x: np.log(np.exp(x) - 0.002))]
    )
    ((_, boundary),) = solve(problem, 0.0, 1e-7).contact(0.0)
    for distance in (1e-6, 1e-4, -1e-6):
        x = boundary + distance
        solution = solve(problem, x, 1e-7)
        gamma = (solution.curvature - solution.slope) / np.exp(2.0 * x)
        wanted = r / (volatility**2 / 2.0 * np.exp(2.0 * x)) if distance > 0.0 else 0.0
        assert gamma == pytest.approx(wanted, abs=5e-3)
        assert solution.slope == pytest.approx(-np.exp(x), abs=1e-3)
