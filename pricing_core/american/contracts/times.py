"""Times in the life of an option that are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.contract import Option
from pricing_core.arrays import Vector, as_vector
from pricing_core.errors import InvalidInputError


def checked_times(option: Option, times: ArrayLike) -> Vector:
    """Return the times, shape (m,), in years from now.

    Raises
    ------
    InvalidInputError
        They do not increase, or lie outside the life of the option.
    """
    chosen = as_vector("times", np.atleast_1d(times))
    if np.any(chosen < 0.0) or np.any(chosen > option.expiry) or np.any(np.diff(chosen) <= 0.0):
        raise InvalidInputError("times", times, "increasing, from 0 to the expiry")
    return chosen
