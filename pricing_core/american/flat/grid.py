"""Grids in log-moneyness x = ln(S/K) and the interval they must cover."""

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.closed_form import perpetual_boundary
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError

LARGEST_STRETCHING = 10.0
FURTHEST = 100.0  # ln(S/K)
SPLIT = 4.0  # width of a two-sided exercise region, in spreads, from which its ends are solved apart


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Nodes x_0 < x_1 < ... < x_{N+1}: boundary values at the two ends, N unknowns between."""

    nodes: Vector  # (N + 2,)

    def __post_init__(self) -> None:
        if self.nodes.size < 3 or not np.all(np.diff(self.nodes) > 0):
            raise InvalidInputError("nodes", self.nodes, "at least 3 increasing numbers")

    @property
    def interior(self) -> Vector:
        """The unknowns' nodes, shape (N,)."""
        return self.nodes[1:-1]


@dataclass(frozen=True, slots=True)
class Domain:
    """The interval of log-moneyness outside of which the early exercise premium is known or negligible.

    Parameters
    ----------
    left, right : float
        ln(S/K) of the ends.
    contact_at_left, contact_at_right : bool
        The option is exercised at that end at all times before expiry.
    neglected : float
        Bound on the premium, as a fraction of the strike, at an end where it is set to zero.
    """

    left: float
    right: float
    contact_at_left: bool
    contact_at_right: bool
    neglected: float


def make_grid(domain: Domain, intervals: int, stretching: float = 0.0) -> Grid:
    """Return a grid of `intervals` cells on `domain`.

    Parameters
    ----------
    stretching : float
        0 to 10. 0: uniform, as in (11.60)-(11.61). s > 0: x = center + c sinh(s u), u uniform, about exp(s)/s times
        finer around x = 0 (the strike) than at the far end.
    """
    if intervals < 2:
        raise InvalidInputError("intervals", intervals, "an integer >= 2")
    if stretching == 0.0:
        return Grid(np.linspace(domain.left, domain.right, intervals + 1))
    center = min(max(0.0, domain.left), domain.right)
    scale = max(center - domain.left, domain.right - center) / math.sinh(stretching)
    ends = np.arcsinh((np.array([domain.left, domain.right]) - center) / scale)
    nodes = center + scale * np.sinh(np.linspace(ends[0], ends[1], intervals + 1))
    nodes[[0, -1]] = domain.left, domain.right
    return Grid(nodes)


def exercise_domain(option: Option, market: FlatMarket, truncation: float, widening: float = 1.0) -> Domain:
    """Return the interval on which an option with volatility and expiry > 0 must be solved.

    Outside, on the side of the payoff, the option is exercised (or, with two boundaries, the premium vanishes);
    on the other side the premium is below about `truncation` of the strike: ln S would have to move
    c standard deviations with c = sqrt(2 ln(20/truncation)), or the perpetual option's premium, which decays
    as a power of S, is smaller still. No end lies more than 100 from the strike: e^x must stay in the range of
    floating-point numbers, and what is neglected there is bounded by the perpetual option.

    Where an exercise region with two ends is so wide that they cannot meet before today, each has a domain of its
    own, from the middle of the region outwards: that on the spot's side is returned.

    Parameters
    ----------
    truncation : float
        Fraction of the strike.
    widening : float
        Multiplies the distance allowed to the exercise boundary, >= 1; above 1 no region is split.
    """
    if option.is_put:
        return _put_domain(option, market, truncation, widening)
    # S*/K of the call is the reciprocal of that of the put with r and q exchanged.
    mirrored = FlatMarket(option.strike / market.spot, market.dividend_yield, market.volatility, market.rate)
    put = _put_domain(Option("put", 1.0, option.expiry), mirrored, truncation, widening)
    neglected = truncation
    if put.neglected > truncation:  # a call is worth at most the spot
        neglected = max(truncation, math.exp(-put.right))
    return Domain(-put.right, -put.left, put.contact_at_right, put.contact_at_left, neglected)


def _put_domain(option: Option, market: FlatMarket, truncation: float, widening: float) -> Domain:
    volatility, expiry = market.volatility, option.expiry
    spread = math.sqrt(2.0 * math.log(20.0 / truncation)) * volatility * math.sqrt(expiry)
    drift = (market.rate - market.dividend_yield - 0.5 * volatility**2) * expiry
    if market.rate < 0.0:
        return _two_sided_domain(option, market, truncation, spread, drift, split=widening == 1.0)
    at_expiry = 0.0
    if 0.0 < market.rate < market.dividend_yield:
        at_expiry = math.log(market.rate / market.dividend_yield)
    left = at_expiry - widening * (spread + max(drift, 0.0))
    right = at_expiry + spread + max(-drift, 0.0)
    perpetual = perpetual_boundary(market, "put")
    decay = (1.0 - perpetual) / perpetual if perpetual > 0.0 else math.inf
    if perpetual > 0.0:
        left = max(left, math.log(perpetual) - 0.02 * spread)
        right = min(right, math.log(1.0 / truncation) * decay)  # its premium: exp(-x / decay)
    right = max(right, at_expiry + 0.1 * spread)
    if right <= FURTHEST:
        return Domain(max(left, -FURTHEST), right, True, False, truncation)
    return Domain(max(left, -FURTHEST), FURTHEST, True, False, max(truncation, math.exp(-FURTHEST / decay)))


def _two_sided_domain(
    option: Option, market: FlatMarket, truncation: float, spread: float, drift: float, *, split: bool
) -> Domain:
    """Put with q < r < 0: the exercise region just before expiry is [ln(r/q), 0]."""
    lowest = math.log(market.rate / market.dividend_yield)
    left, right = lowest - spread - max(drift, 0.0), spread + max(-drift, 0.0)
    middle = 0.5 * lowest
    apart = split and -lowest > SPLIT * (spread + abs(drift))
    upper_half = market.spot >= option.strike * math.exp(middle)
    ends = max(left, -FURTHEST), min(right, FURTHEST)
    neglected = truncation if ends == (left, right) else 1.0
    if apart and upper_half:
        return Domain(max(middle, -spread - abs(drift)), ends[1], True, False, neglected)
    if apart:
        return Domain(ends[0], min(middle, lowest + spread + abs(drift)), False, True, neglected)
    return Domain(*ends, False, False, neglected)
