"""How large a state may become before a run ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pricing_core.errors import NumericalError

LARGEST = 1e140  # squares of such numbers, with weights, are floating-point numbers still


def check_size(values: NDArray[np.float64], t: float) -> None:
    """Raise NumericalError unless the values are numbers whose Euclidean norm is below 1e140: the state overflows at t.

    Examples
    --------
    >>> check_size(np.array([1e200]), 2.5)
    Traceback (most recent call last):
    ...
    pricing_core.errors.NumericalError: the state overflows at t = 2.5: it is not below 1e+140 there
    """
    if not np.vdot(values, values) < LARGEST**2:
        raise NumericalError(f"the state overflows at t = {t:.12g}: it is not below {LARGEST:g} there")
