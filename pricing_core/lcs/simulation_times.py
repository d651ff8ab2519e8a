"""The interval of a simulation, and the times to report."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_vector
from pricing_core.errors import InvalidInputError


def checked_span(t_span: tuple[float, float]) -> tuple[float, float]:
    """Return t_span as two finite increasing numbers, or raise InvalidInputError."""
    try:
        t0, t1 = as_vector("t_span", t_span, 2).tolist()
    except InvalidInputError:
        t0 = t1 = 0.0
    if not 0.0 < t1 - t0 < math.inf:
        raise InvalidInputError("t_span", t_span, "two finite numbers with t_span[0] < t_span[1]")
    return t0, t1


def checked_times(t_eval: ArrayLike, span: tuple[float, float]) -> Vector:
    """Return increasing times inside the interval, or raise InvalidInputError."""
    t0, t1 = span
    times = as_vector("t_eval", t_eval)
    if not np.all((times >= t0) & (times <= t1) & (np.diff(times, prepend=t0) >= 0)):
        raise InvalidInputError("t_eval", t_eval, f"increasing and inside [{t0:g}, {t1:g}]")
    return times
