"""The chapter's road: the system (11.62)-(11.64), and its step (11.65) by the general library and by its own stage."""

import numpy as np
import pytest

from pricing_core.american import Market, Option, price
from pricing_core.lcs import LCSStage, LCSState, TimeStepping, simulate
from pricing_core.obstacle import Diffusion, Obstacle, ObstacleProblem, as_lcs, nodal_method
from pricing_core.stepping import (
    IMPLICIT_EULER,
    SDIRK2,
    DiagonallyImplicit,
    FixedStep,
    PIController,
    StepDoubling,
    integrate,
    theta_method,
)
from tests.obstacle.problems import PRICES, PUT, callable_put, option

TRUE = price(Option("put", 1.0, 1.0), Market(1.0, 0.05, 0.2), tolerance=1e-8).price
INTERVAL = (-1.2, 1.2)


def at_one(x, V):
    return float(np.interp(0.0, x, V))


def test_the_blocks_are_those_of_the_chapter():
    found = as_lcs(option(PUT), 11, INTERVAL)
    system, g = found.system, PUT(found.x, 1.0)
    assert system.shape == (12, 11)
    assert np.array_equal(system.B, np.eye(12, 11))
    assert np.array_equal(system.C, np.column_stack([np.eye(11), -g]))
    assert not system.D.any()
    assert np.array_equal(found.x0, [*g, 1.0])
    both = as_lcs(callable_put(), 11, INTERVAL).system
    assert both.shape == (12, 22)


@pytest.mark.parametrize("tableau", [IMPLICIT_EULER, SDIRK2])
@pytest.mark.parametrize("h", [1e-3, 1e-2, 1e-1])
def test_the_nodal_step_is_the_general_systems_step(tableau, h):
    problem = option(PUT)
    found = as_lcs(problem, 40, INTERVAL)
    method, own, x = nodal_method(problem, 40, INTERVAL, tableau=tableau)
    general_method = DiagonallyImplicit(LCSStage(found.system), tableau)
    general = LCSState(found.x0, np.zeros(40), np.zeros(40))
    assert np.array_equal(x, found.x)
    for k in range(3):
        general = general_method.step(k * h, general, h).state
        own = method.step(k * h, own, h).state
    assert np.allclose(own.value, general.value[:-1], rtol=0.0, atol=1e-11)
    assert np.allclose(own.slack, general.slack, rtol=0.0, atol=1e-11)
    assert np.allclose(own.multiplier, general.multiplier, rtol=0.0, atol=1e-8)
    assert own.multiplier.max() > 1e-3


@pytest.mark.parametrize("lcp_method", ["policy", "psor", "lemke", "brennan-schwartz"])
def test_every_solver_of_the_steps_problem_finds_the_same(lcp_method):
    put = option(PUT, lower=Obstacle(lambda x: 1.0 - np.exp(x)))  # V > 0 of itself
    method, state, _ = nodal_method(put, 60, INTERVAL, lcp_method=lcp_method)
    run = integrate(method, state, (0.0, 1.0), controller=FixedStep(0.05))
    other, state, _ = nodal_method(put, 60, INTERVAL)
    wanted = integrate(other, state, (0.0, 1.0), controller=FixedStep(0.05))
    assert np.allclose(run.states[-1].value, wanted.states[-1].value, rtol=0.0, atol=1e-8)


def test_the_library_simulates_the_system():
    found = as_lcs(option(PUT), 40, INTERVAL)
    run = simulate(found.system, found.x0, (0.0, 1.0), method=TimeStepping("implicit-euler", step=0.02))
    method, state, _ = nodal_method(option(PUT), 40, INTERVAL)
    own = integrate(method, state, (0.0, 1.0), controller=FixedStep(0.02))
    assert np.allclose(run.x[-1, :-1], own.states[-1].value, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("tableau", "damped", "steps", "error"),
    [
        (IMPLICIT_EULER, 0.0, 100, 2e-4),
        (SDIRK2, 0.0, 100, 4e-5),
        (theta_method(0.5), 0.0, 100, 4e-5),
        (theta_method(0.5), 0.02, 100, 4e-5),
    ],
    ids=["implicit Euler", "SDIRK2", "Crank-Nicolson", "Crank-Nicolson with Rannacher's start"],
)
def test_each_scheme_comes_to_the_price(tableau, damped, steps, error):
    method, state, x = nodal_method(option(PUT), 319, INTERVAL, tableau=tableau, damped_until=damped)
    run = integrate(method, state, (0.0, 1.0), controller=FixedStep(1.0 / steps))
    assert at_one(x, run.states[-1].value) == pytest.approx(TRUE, abs=error)


def test_rannachers_start_damps_the_kink_that_crank_nicolson_keeps():
    """The second differences of V next to the strike oscillate without it."""

    def roughness(damped):
        method, state, x = nodal_method(
            option(PUT), 799, INTERVAL, tableau=theta_method(0.5), damped_until=damped
        )
        run = integrate(method, state, (0.0, 1.0), controller=FixedStep(0.05))
        third = np.diff(run.states[-1].value, 3)[np.abs(x[1:-2]) < 0.05]
        return np.abs(third).max()

    assert roughness(0.1) < 0.05 * roughness(0.0)


def test_steps_are_controlled_by_their_error():
    method, state, x = nodal_method(option(PUT), 159, INTERVAL, tableau=SDIRK2)
    run = integrate(StepDoubling(method), state, (0.0, 1.0), controller=PIController(0.0, 1e-6))
    sizes = np.diff(run.t)
    assert sizes.max() > 20.0 * sizes.min()
    assert at_one(x, run.states[-1].value) == pytest.approx(TRUE, abs=1e-4)


def test_two_obstacles_are_one_mixed_problem():
    method, state, x = nodal_method(callable_put(), 319, INTERVAL, tableau=SDIRK2)
    run = integrate(method, state, (0.0, 1.0), controller=FixedStep(0.01))
    V = run.states[-1].value
    assert at_one(x, V) == pytest.approx(0.03, abs=1e-9)
    assert float(np.interp(np.log(0.9), x, V)) == pytest.approx(0.1111496, abs=3e-5)


def test_coefficients_that_depend_on_time_are_those_of_each_stage():
    """One implicit Euler step takes the coefficients at its end; the system of one moment is another one."""
    diffusion = Diffusion(lambda x, t: 0.1 + 0.2 * t, 0.0, 0.0)
    problem = ObstacleProblem(diffusion, PUT, 1.0, ends=PRICES, lower=Obstacle(PUT.value, kinks=[0.0]))
    method, state, _ = nodal_method(problem, 79, INTERVAL)
    end = method.step(0.25, state, 0.25).state  # to t = 0.5
    system = as_lcs(problem, 79, INTERVAL, time=0.5).system
    general = DiagonallyImplicit(LCSStage(system), IMPLICIT_EULER)
    start = LCSState(np.append(state.value, 1.0), np.zeros(79), np.zeros(79))
    assert np.allclose(end.value, general.step(0.0, start, 0.25).state.value[:-1], rtol=0.0, atol=1e-11)
