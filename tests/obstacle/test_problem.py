"""What is refused, each in one sentence, and what a problem says of itself."""

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.obstacle import Diffusion, Event, Held, Obstacle, ObstacleProblem, solve
from tests.obstacle.problems import CALL, PUT, option

LOGNORMAL = Diffusion(0.2, 0.03, 0.05)


def raises(x):
    message = "no name"
    raise AttributeError(message)


def says(message, make):
    with pytest.raises(InvalidInputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("message", "make"),
    [
        (r"volatility = 'x': must be a number", lambda: Diffusion("x", 0.0, 0.0)),
        (
            r"rate = a function of 3 arguments: must be f\(x, t\)",
            lambda: Diffusion(0.2, 0.0, lambda a, b, c: a),
        ),
        (r"breaks = .*: must be", lambda: Diffusion(0.2, 0.0, 0.0, breaks=["x"])),
        (r"obstacle = None: must be a number", lambda: Obstacle(None)),
        (r"during = \(1.0, 1.0\): must be a pair with start < end", lambda: Obstacle(1.0, during=(1.0, 1.0))),
        (r"time = 0.0: must be at least 1e-12: an event at 0 is over", lambda: Event(0.0, cash=1.0)),
        (r"event = .*: must be a move, or cash, or both", lambda: Event(0.5)),
        (
            r"during = \(2.0, 3.0\): must be a window that meets that from 0 to the horizon, 1",
            lambda: option(PUT, lower=Obstacle(PUT.value, during=(2.0, 3.0))),
        ),
        (r"horizon = -1.0: must be at least 1e-12 years", lambda: ObstacleProblem(LOGNORMAL, PUT, -1.0)),
        (
            r"events = 2.0: must be at most the horizon, 1",
            lambda: ObstacleProblem(LOGNORMAL, PUT, 1.0, events=[Event(2.0, cash=1.0)]),
        ),
        (
            r"interval = \(1.0, 0.0\): must be a pair with left < right",
            lambda: option(PUT, interval=(1.0, 0.0)),
        ),
        (
            r"interval = \(None, None\): must be given where a value is held",
            lambda: option(PUT, ends=("linear", Held(0.0))),
        ),
        (
            r"ends = 'flat': must be \"linear\", \"exponential\", a number or Held\(value\)",
            lambda: option(PUT, ends=("flat", "linear")),
        ),
        (r"payoff = 3.0: must be an object of class Obstacle", lambda: ObstacleProblem(LOGNORMAL, 3.0, 1.0)),
    ],
)
def test_a_problem_that_is_none_is_refused_in_a_sentence(message, make):
    says(message, make)


@pytest.mark.parametrize(
    ("message", "problem", "at"),
    [
        (
            r"volatility = 0 at x = .*: must be above 0 at every x and t",
            ObstacleProblem(Diffusion(lambda x: np.where(x > 0.1, 0.0, 0.2), 0.0, 0.05), PUT, 1.0),
            0.0,
        ),
        (
            r"lower = .* at x = .*: must be at most upper, .* there",
            option(
                PUT,
                lower=Obstacle(lambda x, t: 0.0 * x - t),
                upper=Obstacle(lambda x, t: 0.0 * x + 3.0 * t - 2.0),
            ),
            0.0,
        ),
        (
            r"payoff = 0 at x = .*: must be at least the lower obstacle, which acts at the horizon",
            option(PUT, lower=Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.01), kinks=[0.0])),
            0.0,
        ),
        (
            r"rate = nan at x = .*, t = .*: must be finite at every x and t",
            ObstacleProblem(Diffusion(0.2, 0.0, lambda x, t: np.where(x > 0.0, np.nan, 0.05)), PUT, 1.0),
            0.0,
        ),
        (
            r"obstacle = AttributeError at t = 1 \(no name\): must be a function with a number for each x",
            option(Obstacle(raises)),
            0.0,
        ),
        (r"at = 2: must be inside the interval, -1 to 1", option(PUT, interval=(-1.0, 1.0)), 2.0),
        (
            r"obstacle = ValueError at t = .*: must be a function with a number for each x",
            option(PUT, lower=Obstacle(lambda x: np.ones(3))),
            0.0,
        ),
    ],
)
def test_what_only_the_solution_can_see_is_refused_there(message, problem, at):
    says(message, lambda: solve(problem, at))


def test_arguments_of_solve():
    problem = option(PUT)
    says(r"tolerance = 0.0: must be above 0", lambda: solve(problem, 0.0, tolerance=0.0))
    says(r"at = \[\]: must be a number or a vector", lambda: solve(problem, []))
    says(r"interrupt = 3: must be a function", lambda: solve(problem, 0.0, interrupt=3))
    says(r"problem = 1: must be an object of class ObstacleProblem", lambda: solve(1, 0.0))


def test_segments_lie_between_what_happens_the_last_one_first():
    problem = option(
        CALL,
        expiry=2.0,
        lower=Obstacle(CALL.value, kinks=[0.0], during=(0.5, 1.5), at=[0.25]),
        events=[Event(1.0, cash=0.1), Event(2.0, cash=0.1), Event(1.0, move=lambda x: x - 0.1)],
    )
    assert problem.segments == ((1.5, 2.0), (1.0, 1.5), (0.5, 1.0), (0.25, 0.5), (0.0, 0.25))
    assert [event.cash for event in problem.at_event(1.0)] == [0.1, None]  # in the given order
    lower = problem.lower
    assert [lower.acts_between(*segment) for segment in problem.segments] == [False, True, True, False, False]
    assert [lower.acts_at(t) for t in (0.25, 0.3, 0.5, 1.5, 1.6)] == [True, False, True, True, False]
