"""A stretch that is solved: the value at its beginning as a function of x."""

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.collocation_twin.boundary import Boundary
from pricing_core.collocation_twin.profile import Profile, propagate
from pricing_core.collocation_twin.stretch import Stretch


@dataclass(frozen=True, slots=True)
class Held:
    """The value at the beginning of a stretch.

    Parameters
    ----------
    profile : Profile
        At its end, after what the holder may do there.
    stretch : Stretch
    boundary : Boundary or None
        None where the option is not exercised at the beginning.
    at_zero : float
        The value at spot zero.
    """

    profile: Profile
    stretch: Stretch
    boundary: Boundary | None
    at_zero: float

    @property
    def edge(self) -> float:
        """The end of the contact set, NaN without one."""
        return math.nan if self.boundary is None else self.boundary.last

    @property
    def strike(self) -> float:
        """What exercise is measured against."""
        return self.stretch.strike(self.stretch.duration)

    def continued(self, x: Vector) -> Matrix:
        """Return value, slope and second derivative of holding on, shape (3, n)."""
        out = propagate(self.profile, self.stretch.flow, x, self.stretch.duration)
        if self.boundary is not None:
            out += self.boundary.contribution(x)
        return out

    def value(self, x: Vector) -> Matrix:
        """Return value, slope and second derivative, shape (3, n): the payoff's on the contact set."""
        out = self.continued(x)
        if self.boundary is not None:
            sign = self.stretch.sign
            paid = -sign * np.exp(x)
            exercised = sign * (self.edge - x) >= 0.0
            out = np.where(exercised, np.stack([sign * self.strike + paid, paid, paid]), out)
        return out
