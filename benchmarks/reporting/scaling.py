"""Scaling laws: the exponent with which a cost grows along a parameter."""

from collections.abc import Sequence

import numpy as np


def exponent(pairs: Sequence[tuple[float, float]], last: int | None = None) -> float:
    """Return the slope of log cost over log parameter by least squares.

    Parameters
    ----------
    pairs : sequence of (parameter, cost)
        Positive.
    last : int, optional
        Take the largest parameters only, so many of them.

    Returns
    -------
    float
        NaN for fewer than two parameters.

    Examples
    --------
    >>> round(exponent([(10, 2.0), (100, 200.0), (1000, 20_000.0)]), 6)
    2.0
    """
    chosen = sorted(pairs)[-(last or len(pairs)) :]
    if len({parameter for parameter, _ in chosen}) < 2:
        return float("nan")
    parameters, costs = np.log(np.array(chosen, dtype=float)).T
    return float(np.polyfit(parameters, costs, 1)[0])
