"""Optimal control problems with state constraints whose solution is known in closed form."""

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.models import StateConstrainedLQ

INTEGRATOR = [[0.0, 1.0], [0.0, 0.0]]
OSCILLATOR = [[0.0, 1.0], [-1.0, 0.0]]
FORCE, POSITION = [[0.0], [1.0]], [[1.0, 0.0]]
NO_WEIGHT = np.zeros((2, 2))


@dataclass(frozen=True)
class ControlProblem:
    """A problem and what is known of its solution."""

    name: str
    problem: StateConstrainedLQ
    cost: float
    switching_times: tuple[float, ...]
    atoms: tuple[tuple[float, float], ...]


def stopped_scalar(horizon: float) -> ControlProblem:
    """x' = -x + u, x >= 1, from 2: free up to arccosh(2)/sqrt(2), then x = u = lambda = 1."""
    junction = math.acosh(2.0) / math.sqrt(2.0)
    a = 2.0 * math.acosh(2.0)
    free = (math.sinh(a) - (math.cosh(a) - 1.0) / math.sqrt(2.0)) / (2.0 * math.sqrt(2.0))
    problem = StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [2], horizon, [1])
    cost = free + horizon - junction
    return ControlProblem("stopped scalar", problem, cost, (junction,), ((horizon, 1.0),))


def scalar_that_just_arrives(horizon: float) -> ControlProblem:
    """The same with a horizon before the junction and after the time at which x without constraint is 1.

    x'' = 2x with x(0) = 2 and x(T) = 1; the atom at T is lambda(T-) = x'(T) + x(T).
    """
    w, T = math.sqrt(2.0), horizon
    b = (1.0 - 2.0 * math.cosh(w * T)) / math.sinh(w * T)
    slope = w * (2.0 * math.sinh(w * T) + b * math.cosh(w * T))
    atom, start = slope + 1.0, w * b + 2.0
    problem = StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [2], horizon, [1])
    return ControlProblem("just arrives", problem, 0.5 * (atom - 2.0 * start), (), ((T, atom),))


def scalar_held_without_weight(horizon: float) -> ControlProblem:
    """x' = -x + u, x >= 1, Q = 0, from 2: u = sigma e^t, and from the junction on u = lambda = eta = 1.

    The junction, if the horizon reaches it, is where x = 1 and x' = 0: z = e^-t = 2 - sqrt(3), sigma = z. Otherwise
    contact is at the horizon alone, and its atom is lambda there.
    """
    T, z = horizon, 2.0 - math.sqrt(3.0)
    problem = StateConstrainedLQ([[-1]], [[1]], [[1]], [[0]], [2], T, [1])
    if -math.log(z) < T:
        cost = 0.25 * (1.0 - z**2) + 0.5 * (T + math.log(z))
        return ControlProblem("held without weight", problem, cost, (-math.log(z),), ((T, 1.0),))
    sigma = (1.0 - 2.0 * math.exp(-T)) / math.sinh(T)
    cost = 0.25 * sigma**2 * (math.exp(2.0 * T) - 1.0)
    return ControlProblem("caught without weight", problem, cost, (), ((T, sigma * math.exp(T)),))


def resting_on_the_bound(horizon: float) -> ControlProblem:
    """x'' = u from rest at 1, x >= 1, Q = I: at rest, where eta = 1."""
    problem = StateConstrainedLQ(INTEGRATOR, FORCE, POSITION, np.eye(2), [1, 0], horizon, [1])
    return ControlProblem("resting on the bound", problem, 0.5 * horizon, (), ())


def braked_at_the_end(v: float, T: float) -> ControlProblem:
    """x'' = u from (1, -v), x >= 0, Q = 0, 1/v < T < 3/v: u = sigma (T - t), contact only at T."""
    sigma = 3.0 * (v * T - 1.0) / T**3
    problem = StateConstrainedLQ(INTEGRATOR, FORCE, POSITION, NO_WEIGHT, [1, -v], T)
    return ControlProblem("braked at the end", problem, sigma**2 * T**3 / 6.0, (), ((T, sigma),))


def braked_before_the_end(v: float, T: float) -> ControlProblem:
    """The same with T > 3/v: u = sigma (3/v - t), then at rest; cost 2 v^3/9 = sigma."""
    sigma, touch = 2.0 * v**3 / 9.0, 3.0 / v
    problem = StateConstrainedLQ(INTEGRATOR, FORCE, POSITION, NO_WEIGHT, [1, -v], T)
    return ControlProblem("braked before the end", problem, sigma, (touch,), ((touch, sigma),))


def caught_oscillator(sigma: float, touch: float, T: float) -> ControlProblem:
    """x'' = -x + u, x >= -1, Q = 0: u = sigma sin(touch - t) up to the touch point (-1, 0), then nothing.

    With s = touch - t: x(t) = -cos s + (sigma/2)(sin s - s cos s).
    """
    s = touch
    position = -math.cos(s) + 0.5 * sigma * (math.sin(s) - s * math.cos(s))
    velocity = -math.sin(s) - 0.5 * sigma * s * math.sin(s)
    problem = StateConstrainedLQ(OSCILLATOR, FORCE, POSITION, NO_WEIGHT, [position, velocity], T, [-1])
    cost = 0.25 * sigma**2 * (s - 0.5 * math.sin(2.0 * s))
    return ControlProblem("caught oscillator", problem, cost, (touch,), ((touch, sigma),))


def returning_oscillator(touch: float, T: float) -> ControlProblem:
    """The same from the bound itself, which the oscillator leaves with a speed and comes back to."""
    s = touch
    return caught_oscillator(2.0 * (math.cos(s) - 1.0) / (math.sin(s) - s * math.cos(s)), s, T)


def lowered_cart(sigma: float, junction: float, T: float) -> ControlProblem:
    """x'' = u, Q = diag(4, 0), x >= 1: down to the bound and along it, where u = 0 and eta = 4.

    In s = junction - t, x'''' = -4x with x = 1, x' = x'' = 0, x''' = sigma at s = 0, hence
    x = cos s cosh s + sigma (sin s cosh s - cos s sinh s)/4, and lambda_1 = x''' there: the entry has the atom sigma.
    """
    s = junction
    c, d, ch, sh = math.cos(s), math.sin(s), math.cosh(s), math.sinh(s)
    position = c * ch + 0.25 * sigma * (d * ch - c * sh)
    velocity = -(c * sh - d * ch + 0.5 * sigma * d * sh)
    jerk = -2.0 * (c * sh + d * ch) + sigma * c * ch  # d^3/ds^3, which is lambda_1
    force = -2.0 * d * sh + 0.5 * sigma * (d * ch + c * sh)  # x'', which is lambda_2
    problem = StateConstrainedLQ(
        INTEGRATOR, FORCE, POSITION, np.diag([4.0, 0.0]), [position, velocity], T, [1]
    )
    cost = 0.5 * (sigma + 4.0 * (T - s) - jerk * position - force * velocity)
    return ControlProblem("lowered cart", problem, cost, (s,), ((s, sigma),))


def ramp_to_a_touch(sigma: float, touch: float, T: float) -> ControlProblem:
    """x''' = u, x >= 0, Q = 0, order 3: u = sigma s^2/2 with s = touch - t, arriving with x' = 0, x'' = 1."""
    s = touch
    state = [
        0.5 * s**2 - sigma * s**5 / 120.0,
        -s + sigma * s**4 / 24.0,
        1.0 - sigma * s**3 / 6.0,
    ]
    problem = StateConstrainedLQ(
        np.eye(3, k=1), [[0], [0], [1]], [[1, 0, 0]], np.zeros((3, 3)), state, T, [0]
    )
    return ControlProblem("ramp to a touch", problem, sigma**2 * s**5 / 40.0, (s,), ((s, sigma),))


CONTROL_PROBLEMS = (
    stopped_scalar(3.0),
    scalar_that_just_arrives(0.8),
    scalar_held_without_weight(3.0),
    scalar_held_without_weight(1.0),
    resting_on_the_bound(1.0),
    resting_on_the_bound(4.0),
    braked_at_the_end(1.0, 2.0),
    braked_before_the_end(1.0, 4.0),
    caught_oscillator(0.7, 2.0, 5.0),
    caught_oscillator(0.7, 2.0, 9.0),
    returning_oscillator(5.0, 9.0),
    lowered_cart(1.5, 1.0, 3.0),
    ramp_to_a_touch(2.0, 1.0, 2.0),
)
