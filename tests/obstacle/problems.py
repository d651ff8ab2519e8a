"""Named obstacle problems over x = ln S with strike 1, and where their true values come from."""

import numpy as np

from pricing_core.obstacle import Diffusion, Held, Obstacle, ObstacleProblem

PUT = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
CALL = Obstacle(lambda x: np.maximum(np.exp(x) - 1.0, 0.0), kinks=[0.0])
STRADDLE = Obstacle(lambda x: np.abs(np.exp(x) - 1.0), kinks=[0.0])
CAP = 0.3
CAPPED_CALL = Obstacle(lambda x: np.clip(np.exp(x) - 1.0, 0.0, CAP), kinks=[0.0, np.log1p(CAP)])
PENALTY = 0.03
PUT_AND_PENALTY = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0) + PENALTY, kinks=[0.0])
PRICES = ("exponential", "exponential")


def option(
    payoff: Obstacle, *, rate=0.05, dividend_yield=0.0, volatility=0.2, expiry=1.0, american=True, **choices
) -> ObstacleProblem:
    """A contract on a lognormal price, over its logarithm."""
    drift = rate - dividend_yield - volatility**2 / 2.0
    if american:
        choices.setdefault("lower", payoff)
    choices.setdefault("ends", PRICES)
    return ObstacleProblem(Diffusion(volatility, drift, rate), payoff, expiry, **choices)


def callable_put(**choices) -> ObstacleProblem:
    """An American put that its writer may call for its payoff and a penalty."""
    return option(PUT, rate=0.05, dividend_yield=0.03, volatility=0.25, upper=PUT_AND_PENALTY, **choices)


# At S = 0.9, 1, 1.1: a nodal complementarity problem with the kink on a node, extrapolated; the first and the third to
# seven digits also by the closed formula of a knock-out with rebate.
CALLABLE_PUT = {0.9: 0.1111496, 1.0: 0.03, 1.1: 0.0210425}


def capped_call() -> ObstacleProblem:
    """An American call that pays at most the cap."""
    return option(CAPPED_CALL, rate=0.05, dividend_yield=0.03, volatility=0.25)


AMERICAN_CAPPED_CALL = (
    0.1026901  # at S = 1, a nodal complementarity problem with the kink on a node, extrapolated
)


def up_and_out_call(barrier: float, **choices) -> ObstacleProblem:
    """A European call that is worth nothing once the price reaches the barrier."""
    return option(
        CALL,
        american=False,
        interval=(None, float(np.log(barrier))),
        ends=("exponential", Held(0.0)),
        **choices,
    )
