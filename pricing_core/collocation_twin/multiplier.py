"""The multiplier's contribution to the value: u = r - q e^x on the contact set (a put; its negative for a call)."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from pricing_core.arrays import Vector
from pricing_core.collocation_twin.flow import Flow
from pricing_core.collocation_twin.profile import normal_density


class Source(NamedTuple):
    """What one unit of time of the multiplier is worth `age` later, and its derivatives.

    by_x, by_xx: by the place x it is seen from; by_boundary, by_boundary_x: by the boundary, and the slope's.
    """

    value: Vector
    by_x: Vector
    by_xx: Vector
    by_boundary: Vector
    by_boundary_x: Vector


def source(sign: float, flow: Flow, x: Vector | float, boundary: Vector, age: Vector) -> Source:
    """Return the source at x of the contact set that ended at `boundary` so long ago, age > 0.

    Parameters
    ----------
    sign : float
        1 for a put, whose contact set lies below the boundary; -1 for a call.
    """
    spread = flow.volatility * np.sqrt(age)
    d2 = (x - boundary + flow.drift * age) / spread
    interest = flow.rate * np.exp(-flow.rate * age)
    dividends = flow.dividend * np.exp(x - flow.dividend * age) * ndtr(-sign * (d2 + spread))
    at_boundary = flow.rate - flow.dividend * np.exp(boundary)
    # e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}
    density = normal_density(d2) * np.exp(-flow.rate * age) / spread
    turn = at_boundary * density * d2 / spread
    return Source(
        value=sign * (interest * ndtr(-sign * d2) - dividends),
        by_x=-at_boundary * density - sign * dividends,
        by_xx=turn + flow.dividend * np.exp(boundary) * density - sign * dividends,
        by_boundary=at_boundary * density,
        by_boundary_x=-turn,
    )
