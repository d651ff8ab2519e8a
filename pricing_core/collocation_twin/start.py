"""Where, when and how the contact set of a stretch begins."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from pricing_core.collocation_twin.boundary import Start, shifted_start
from pricing_core.collocation_twin.panels import Feature
from pricing_core.collocation_twin.profile import Profile, propagate
from pricing_core.collocation_twin.stretch import Stretch
from pricing_core.collocation_twin.touching import search_touching
from pricing_core.roots import find_root

TAIL_SPLIT = 2.0  # times the time at which it begins, a contact set from far away has arrived
ARRIVED, MOST_OF_THE_WAY = 1.3, 0.7
FAR = 1.5  # spreads
SOONEST = 1e-3  # of the stretch
WORTH_SPLITTING = 1.1
SEEN = 0.02  # of the stretch: sooner the panels are too wide to show the tail
AT_ONCE = 1e-9  # of the stretch
# Of the stretch: how closely its time is looked for at which a contact set begins, and at which it has arrived.
CLOSE, ROUGHLY = 1e-7, 1e-2
FAST = 4.0  # spreads by which a contact set grows that spreads faster than diffusion follows
STEEP = 1e-6  # of the slope far away: then value and payoff part like lines, not like a normal tail
OVERHANGING = 1e-4  # of the slope far away: then the contact set begins somewhere else, with two ends
DEEP, SHALLOW = 2.0, 0.25  # spreads from the bend towards exercise at which a tail is looked at
LOWEST, HIGHEST = 1e-6, 0.9  # of its height


class UnservedError(Exception):
    """The contact set is of a kind that this scheme does not follow."""


@dataclass(frozen=True, slots=True)
class Outset:
    """What is known of a stretch before its contact set begins.

    Parameters
    ----------
    profile : Profile
    stretch : Stretch
    contact : float
        End of the contact set at the stretch's end, infinite without one.
    relevant : float
        x beyond which, on the side of exercise, the value does not matter.
    features : tuple of Feature
    nodes_only : bool
        Whether the value there is known at nodes only, and not as a line: what happens at once is not seen then.
    """

    profile: Profile
    stretch: Stretch
    contact: float
    relevant: float
    features: tuple[Feature, ...]
    nodes_only: bool

    def begins(self) -> bool:
        """Tell whether there is a contact set, now or before the stretch's beginning."""
        stretch = self.stretch
        if not (stretch.exercisable and stretch.can_pay()):
            return False
        if stretch.sign * (self.contact - self.relevant) > 0.0:
            return True
        reached = stretch.sign * (stretch.furthest() - self.relevant) > 0.0
        return reached and self.above(self.relevant, stretch.duration) < 0.0

    def bend(self) -> float:
        """Return where the value bends next to what is held."""
        bends = [feature.place for feature in self.features if feature.scale == 0.0]
        return (max if self.stretch.sign > 0.0 else min)(bends, default=0.0)

    def height(self, x: float, s: float) -> float:
        """Return 1 + delta of a put, 1 - delta of a call, both without exercise before s."""
        by_x = float(propagate(self.profile, self.stretch.flow, np.array([x]), s)[1, 0])
        return 1.0 + self.stretch.sign * by_x * math.exp(-x)

    def above(self, x: float, s: float) -> float:
        """Return how much holding, without exercise before s, is worth more than exercise at x."""
        held = float(propagate(self.profile, self.stretch.flow, np.array([x]), s)[0, 0])
        return held - self.stretch.payoff(x, s)


def find_start(outset: Outset) -> tuple[Start | None, float]:
    """Return the start, None where nothing is exercised, and the time at which the stretch is best parted, or 0.

    Raises
    ------
    UnservedError
        The contact set begins between two places.
    """
    if not outset.begins():
        return None, 0.0
    stretch, relevant = outset.stretch, outset.relevant
    sign, furthest, duration = stretch.sign, stretch.furthest(), stretch.duration
    if sign * (outset.contact - relevant) > 0.0:
        place = (min if sign > 0.0 else max)(outset.contact, furthest)
        ahead = place + FAST * sign * stretch.spread
        if outset.above(ahead, duration) < 0.0:
            return _shifted(outset, 0.0, place)
        is_gradual = sign * (furthest - outset.contact) <= 0.0
        return Start("plain" if is_gradual or outset.profile.continues(stretch) else "root", 0.0, place), 0.0
    soon = (SEEN if outset.profile.nodes.size and outset.nodes_only else AT_ONCE) * duration
    begins = soon
    if outset.above(relevant, soon) > 0.0:
        begins = find_root(lambda s: outset.above(relevant, s), soon, duration, CLOSE * duration)
    steepness = outset.height(relevant, begins) * math.exp(relevant)
    if steepness < -OVERHANGING:
        raise UnservedError
    if sign < 0.0 or steepness > STEEP or relevant < stretch.gone():
        return _shifted(outset, begins, relevant)
    split = TAIL_SPLIT * begins
    worth = WORTH_SPLITTING * split < duration and split > 1e-6 * duration
    return _tail(outset, begins), split if worth else 0.0


def _shifted(outset: Outset, begins: float, place: float) -> tuple[Start, float]:
    start = shifted_start(outset.profile, outset.stretch, begins, place)
    assert start.touching is not None
    return start, _arrival(outset, begins, place, start.touching.x)


def _arrival(outset: Outset, begins: float, place: float, end: float) -> float:
    """Return a time after that at which a contact set that grows far and fast has arrived; 0 where it does not.

    The boundary is near the place where the value without exercise is the payoff, which is followed until it has gone
    most of its way.
    """
    stretch = outset.stretch
    if stretch.sign * (end - place) < FAR * stretch.spread:
        return 0.0
    most = place + MOST_OF_THE_WAY * (end - place)
    soon = max(begins, AT_ONCE * stretch.duration)
    if outset.above(most, soon) <= 0.0:
        return 0.0
    close = ROUGHLY * stretch.duration
    arrival = ARRIVED * find_root(lambda s: outset.above(most, s), soon, stretch.duration, close)
    return arrival if SOONEST * stretch.duration < arrival < stretch.duration / WORTH_SPLITTING else 0.0


def _tail(outset: Outset, begins: float) -> Start:
    """Return the start whose tail has the shape of 1 + delta at that time, from its height at two places."""
    stretch = outset.stretch
    seen = max(begins, SEEN * stretch.duration)
    spread = stretch.sign * stretch.flow.volatility * math.sqrt(seen)
    bend = outset.bend() - stretch.flow.drift * seen
    deep, shallow = bend - DEEP * spread, bend - SHALLOW * spread
    low, high = (float(ndtri(min(max(outset.height(x, seen), LOWEST), HIGHEST))) for x in (deep, shallow))
    scale = abs((shallow - deep) / (high - low)) if high != low else math.inf
    scale = min(max(scale, 0.5 * abs(spread)), 5.0 * abs(spread))
    touching = search_touching(outset.profile, stretch, begins, outset.relevant, stretch.duration)
    return Start("tail", begins, outset.relevant, touching, shallow - stretch.sign * scale * high, scale)
