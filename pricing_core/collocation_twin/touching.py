"""Where the value without exercise meets the payoff: near there ends a contact set that comes from far away."""

import math
from typing import NamedTuple

import numpy as np

from pricing_core.collocation_twin.profile import Profile, propagate
from pricing_core.collocation_twin.stretch import Stretch

MOST_STEPS = 200  # of a search
MOST_NEAR_STEPS = 8
SHORT = 0.01  # spreads: after a step of Halley's method that short the place is known to its cube


class _Gap(NamedTuple):
    """The value without exercise less the payoff, and its derivatives."""

    value: float
    by_x: float
    by_xx: float
    by_s: float

    def step(self) -> float:
        """Return a step of Halley's method."""
        newton = self.value / self.by_x
        return -newton / (1.0 - 0.5 * newton * self.by_xx / self.by_x)


def _gap(profile: Profile, stretch: Stretch, x: float, s: float) -> _Gap:
    sign, flow = stretch.sign, stretch.flow
    value, by_x, by_xx = propagate(profile, flow, np.array([x]), s)[:, 0]
    spot, strike = math.exp(x), stretch.strike(s)
    grown = 0.5 * flow.volatility**2 * (by_xx - by_x) + (flow.rate - flow.dividend) * by_x - flow.rate * value
    return _Gap(
        value - sign * (strike - spot),
        by_x + sign * spot,
        by_xx + sign * spot,
        grown - sign * flow.rate * (1.0 - strike),
    )


class Touching(NamedTuple):
    """The place at one time, and how it moves.

    Parameters
    ----------
    x : float
    root : float
        sqrt(s - time), with the time at which the contact set begins.
    speed : float
        dx by it.
    """

    x: float
    root: float
    speed: float


def _moving(x: float, gap: _Gap, begins: float, s: float) -> Touching:
    root = math.sqrt(s - begins)
    return Touching(x, root, -2.0 * root * gap.by_s / gap.by_x)


def search_touching(profile: Profile, stretch: Stretch, begins: float, place: float, s: float) -> Touching:
    """Return where the value meets the payoff at time s, from a place on the side of exercise."""
    # Panels are fine enough for such a step next to the place.
    step = stretch.sign * stretch.flow.volatility * math.sqrt(s)
    inside = place
    for _ in range(MOST_STEPS):
        if _gap(profile, stretch, inside, s).value <= 0.0:
            break
        inside -= step
    outside = inside + step
    found = _gap(profile, stretch, outside, s)
    for _ in range(MOST_STEPS):
        if found.value >= 0.0:
            break
        inside, outside = outside, outside + step
        found = _gap(profile, stretch, outside, s)
    x = outside
    for _ in range(MOST_STEPS):
        if found.value > 0.0:
            outside = x
        else:
            inside = x
        wanted = x + found.step()
        is_between = min(inside, outside) <= wanted <= max(inside, outside)
        moved, x = x, wanted if is_between else 0.5 * (inside + outside)
        if abs(x - moved) <= SHORT * abs(step):
            break
        found = _gap(profile, stretch, x, s)
    return _moving(x, found, begins, s)


def touching_before(
    later: Touching, profile: Profile, stretch: Stretch, begins: float, place: float, s: float
) -> Touching:
    """Return the same at a time s nearer to the stretch's end, from where it is at a later one."""
    spread = stretch.flow.volatility * math.sqrt(s)
    x = later.x + later.speed * (math.sqrt(s - begins) - later.root)
    for _ in range(MOST_NEAR_STEPS):
        gap = _gap(profile, stretch, x, s)
        step = gap.step()
        if not (stretch.sign * gap.by_x > 0.0 and abs(step) < spread):
            break
        x += step
        if abs(step) <= SHORT * spread:
            return _moving(x, gap, begins, s)
    return search_touching(profile, stretch, begins, place, s)
