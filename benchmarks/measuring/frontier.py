"""The time that a method takes for an accuracy: the lower envelope of its settings, and points between them."""

import math
from collections.abc import Iterable
from typing import NamedTuple


class Point(NamedTuple):
    """The error that one setting of a method reaches, and its cost."""

    error: float
    microseconds: float


def lower_envelope(points: Iterable[Point], gain: float = 0.0) -> tuple[Point, ...]:
    """Return the points that no other point beats in both error and time, the fastest first.

    Each has an error smaller by at least the share `gain` than the one before.
    """
    envelope: list[Point] = []
    for point in sorted(points, key=lambda point: (point.microseconds, point.error)):
        if 0.0 < point.error < math.inf and (not envelope or point.error < (1.0 - gain) * envelope[-1].error):
            envelope.append(point)
    return tuple(envelope)


def time_at(points: Iterable[Point], error: float) -> float | None:
    """Return the time for an error, between two points of the lower envelope by a straight line in logarithms.

    Parameters
    ----------
    points : iterable of Point
        In any order; those above the lower envelope do not count.
    error : float
        Positive.

    Returns
    -------
    float or None
        Microseconds; for an error above that of the fastest point its time, None below that of the most
        accurate one.

    Examples
    --------
    >>> time_at([Point(1e-2, 1.0), Point(1e-4, 100.0)], 1e-3)
    10.0
    """
    envelope = lower_envelope(points)
    if not envelope or error < envelope[-1].error:
        return None
    if error >= envelope[0].error:
        return envelope[0].microseconds
    finer = next(i for i, point in enumerate(envelope) if point.error <= error)
    coarse, fine = envelope[finer - 1], envelope[finer]
    share = math.log(error / coarse.error) / math.log(fine.error / coarse.error)
    return float(coarse.microseconds * (fine.microseconds / coarse.microseconds) ** share)
