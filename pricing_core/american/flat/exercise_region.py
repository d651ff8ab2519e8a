"""The exercise boundary of one semidiscrete state, between the grid nodes.

Just inside the continuation region v - g is the parabola J (x - x_f)**2/2 (smooth pasting: v - g and its
slope vanish at x_f), so sqrt(v - g) is straight and points at x_f. On a grid the last contact node stands in
for the boundary, and the discrete solution is that parabola lowered by up to J dx**2/8: the root of sqrt(v -
g) is then off by a large part of a cell, but the vertex of the parabola is not. The vertex of the cubic
through the last contact node and three free ones is therefore taken: measured on nine reference boundaries,
three to ten times closer than the root.
"""

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.contract import LARGEST_MONEY, Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.closed_form import LARGEST_EXPONENT
from pricing_core.american.flat.tridiagonal_step import OptionState
from pricing_core.arrays import Vector

FITTED_NODES = 4


@dataclass(frozen=True, slots=True)
class ExerciseRegion:
    """The log-moneyness interval [lower, upper] in which the option is exercised; empty where lower > upper.

    The end that belongs to the far side (S -> 0 for a put, S -> inf for a call) is infinite unless there are
    two boundaries.
    """

    lower: float
    upper: float

    def contains(self, x: float) -> bool:
        """Whether x lies in the closed region."""
        return self.lower <= x <= self.upper

    def is_open_at_strike(self, option: Option) -> bool:
        """Whether the end nearer the strike is not known: it lies on a domain of its own."""
        return self.lower <= self.upper and math.isinf(self.upper if option.is_put else self.lower)

    def completed_by(self, near: "ExerciseRegion") -> "ExerciseRegion":
        """Return this region with its unknown end taken from another."""
        return ExerciseRegion(max(self.lower, near.lower), min(self.upper, near.upper))

    def boundaries(self, option: Option) -> tuple[float, float]:
        """Return S*, the boundary nearer the strike, and the other one, in money; NaN where there is none."""
        if self.lower > self.upper:
            return math.nan, math.nan
        ends = (self.upper, self.lower) if option.is_put else (self.lower, self.upper)
        near, far = (option.strike * math.exp(min(end, LARGEST_EXPONENT)) for end in ends)
        return near if near <= LARGEST_MONEY else math.nan, far if 0.0 < far <= LARGEST_MONEY else math.nan


EMPTY_REGION = ExerciseRegion(math.inf, -math.inf)


def region_at_expiry(option: Option, market: FlatMarket) -> ExerciseRegion:
    """Return the limit of the exercise region just before expiry; also the region at zero volatility.

    Where the payoff is positive and holding it earns less than exercising, r K > q S for the put: S*/K =
    min(1, r/q) for r, q > 0; [r/q, 1] for q < r < 0; the call with the inequalities reversed.
    """
    rate, dividend_yield = market.rate, market.dividend_yield
    if never_exercised(option, market):
        return EMPTY_REGION
    if option.is_put:
        if rate < 0.0:
            return ExerciseRegion(math.log(rate / dividend_yield), 0.0)
        return ExerciseRegion(
            -math.inf, math.log(rate / dividend_yield) if 0.0 < rate < dividend_yield else 0.0
        )
    if dividend_yield < 0.0:
        return ExerciseRegion(0.0, math.log(rate / dividend_yield))
    return ExerciseRegion(math.log(rate / dividend_yield) if 0.0 < dividend_yield < rate else 0.0, math.inf)


def never_exercised(option: Option, market: FlatMarket) -> bool:
    """Whether early exercise is never optimal: puts with r <= 0 and r <= q, calls with q <= 0 and q <= r."""
    rate, dividend_yield = market.rate, market.dividend_yield
    if option.is_put:
        return rate <= 0.0 and rate <= dividend_yield
    return dividend_yield <= 0.0 and dividend_yield <= rate


def exercise_region(
    state: OptionState, nodes: Vector, reaches_left: bool, reaches_right: bool
) -> ExerciseRegion:
    """Locate the ends of the exercise region of one state.

    Parameters
    ----------
    nodes : Vector, shape (N,)
        Log-moneyness of the unknowns.
    reaches_left, reaches_right : bool
        The region extends beyond that end of the grid.
    """
    contact = np.flatnonzero(state.contact)
    lower = -math.inf if reaches_left else math.inf
    upper = math.inf if reaches_right else -math.inf
    if contact.size == 0:  # thinner than a cell, or beyond the end
        if reaches_left:
            return ExerciseRegion(lower, float(nodes[0]))
        return ExerciseRegion(float(nodes[-1]), upper) if reaches_right else EMPTY_REGION
    first, last = int(contact[0]), int(contact[-1])
    if not reaches_left:
        lower = _vertex(nodes, state.slack, first, -1)
    if not reaches_right:
        upper = _vertex(nodes, state.slack, last, 1)
    return ExerciseRegion(lower, upper)


def _vertex(nodes: Vector, slack: Vector, contact: int, direction: int) -> float:
    """Return where the cubic through contact node and three free nodes in `direction` has zero slope."""
    indices = contact + direction * np.arange(FITTED_NODES)
    if indices.min() < 0 or indices.max() >= nodes.size:
        return float(nodes[contact])
    width = abs(float(nodes[indices[1]] - nodes[contact]))
    u = direction * (nodes[indices] - nodes[contact]) / width
    coefficients = np.linalg.solve(np.vander(u, increasing=True), slack[indices])
    slope, half_curvature, third = (float(c) for c in coefficients[1:])
    # The root of slope + 2 half_curvature u + 3 third u**2 that stays finite as third -> 0.
    discriminant = half_curvature**2 - 3.0 * third * slope
    denominator = half_curvature + math.sqrt(max(discriminant, 0.0))
    if half_curvature <= 0.0 or discriminant < 0.0:
        return float(nodes[contact])
    return float(nodes[contact]) + direction * width * min(max(-slope / denominator, -1.0), 1.0)
