"""The value as a function of x = ln(S/K) at one instant, and what it is worth earlier if it is not exercised."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from pricing_core.arrays import Matrix, Vector
from pricing_core.collocation_twin.flow import Flow
from pricing_core.collocation_twin.stretch import Stretch

ONE_OVER_SQRT_TWO_PI = 1.0 / math.sqrt(2.0 * math.pi)
FURTHEST = 9.0  # standard deviations: what lies further away has no weight
AT_ONCE = 256  # places: what they need fits into the memory


class Piece(NamedTuple):
    """constant + slope e^x for lower < x < upper; the ends may be infinite."""

    lower: float
    upper: float
    constant: float
    slope: float


@dataclass(frozen=True, slots=True)
class Profile:
    """Pieces that are linear in the spot, and Gauss nodes on the rest of the line.

    Parameters
    ----------
    pieces : tuple of Piece
    nodes : Vector, shape (n,)
    weighted : Vector, shape (n,)
        The value at the nodes times their weights.
    """

    pieces: tuple[Piece, ...]
    nodes: Vector
    weighted: Vector

    def continues(self, stretch: Stretch) -> bool:
        """Whether this end of the stretch is but a place in a contact set's history, at which nothing happens."""
        return stretch.is_continuous and stretch.exercise_at_end and self.nodes.size > 0


def normal_density(z: Vector) -> Vector:
    """Return the density of the standard normal distribution."""
    return np.asarray(ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * z * z))


def propagate(profile: Profile, flow: Flow, x: Vector, s: float) -> Matrix:
    """Return value, slope and second derivative by x of e^{sL} profile at x, shape (3, n), for s > 0."""
    parts = [_propagate(profile, flow, x[k : k + AT_ONCE], s) for k in range(0, x.size, AT_ONCE)]
    return np.concatenate(parts, axis=1) if parts else np.zeros((3, 0))


def _propagate(profile: Profile, flow: Flow, x: Vector, s: float) -> Matrix:
    spread = flow.volatility * math.sqrt(s)
    centre = x + flow.drift * s
    bond, stock = math.exp(-flow.rate * s), np.exp(x - flow.dividend * s)
    out = np.zeros((3, x.size))
    near = np.abs(profile.nodes - 0.5 * (centre.min() + centre.max())) < FURTHEST * spread + 0.5 * np.ptp(
        centre
    )
    if near.any():
        z = (profile.nodes[near] - centre[:, None]) / spread
        density, weighted = normal_density(z) * (bond / spread), profile.weighted[near]
        out[0] = density @ weighted
        out[1] = (density * z) @ weighted / spread
        out[2] = (density * (z * z - 1.0)) @ weighted / spread**2
    for piece in profile.pieces:
        for end, sign in ((piece.upper, 1.0), (piece.lower, -1.0)):
            if end == -math.inf:
                continue
            in_stock = piece.slope * stock
            if end == math.inf:
                out += sign * in_stock
                out[0] += sign * piece.constant * bond
                continue
            z = (end - centre) / spread
            in_stock = in_stock * ndtr(z - spread)
            density = normal_density(z) * (bond / spread)
            there = piece.slope * math.exp(end)
            out[0] += sign * (piece.constant * bond * ndtr(z) + in_stock)
            out[1] += sign * (in_stock - (piece.constant + there) * density)
            out[2] += sign * (in_stock - ((piece.constant + there) * z / spread + there) * density)
    return out
