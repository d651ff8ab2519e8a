"""Infinitely many events before an instant: diagnosed from rounds of modes whose durations shrink geometrically."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcs.trajectory import Event

ROUNDS = 3  # Least number of rounds that must have passed.
LONGEST_ROUND = 64  # Largest number of events in a round.
# Largest time to the limit, as a share of the time since the first event.
NEAR = 1e-5
# Largest uncertainty of the limit from the ratios' scatter, as a share of that time.
CERTAIN = 1e-11
# Time to the limit, as a share of that time, within which rounding scatters the ratios.
CLOSE = 1e-6
# Largest uncertainty of a limit so close, as a share of the time to it.
LOOSE = 1e-3
# Share of the state at the rounds' start below which a component is zero at the limit.
GONE = 1e-6


class ZenoLimit(NamedTuple):
    """Where the events accumulate, the state there, and the ratio of the rounds' durations."""

    time: float
    x: Vector
    ratio: float


def zeno_limit(events: list[Event], end: float) -> ZenoLimit | None:
    """Return the limit of the last events before `end`, None where they do not accumulate.

    A diagnosis, not a proof: the modes repeat in rounds, the rounds' durations shrink by one ratio, and little is left
    of the series. The ratio must be so steady that its scatter leaves the sum of the series certain, less so where next
    to nothing is left. The state's components are extrapolated by ratios of their own.
    """
    recent = [event for event in events[-ROUNDS * LONGEST_ROUND - 1 :] if event.kind != "grazing"]
    length = _round_length(recent)
    if length is None:
        return None
    marks = recent[-1 - ROUNDS * length :: length]
    durations = np.diff([event.time for event in marks])
    if np.any(durations <= 0.0):
        return None
    ratios = durations[1:] / durations[:-1]
    ratio = float(ratios[-1])
    if not ratio < 1.0:
        return None
    left = float(durations[-1]) * ratio / (1.0 - ratio)
    doubt = left * float(np.ptp(ratios)) / (ratio * (1.0 - ratio))
    first = next(event for event in events if event.kind != "grazing").time
    time, elapsed = marks[-1].time + left, marks[-1].time - first
    sure = doubt <= CERTAIN * elapsed or (left <= CLOSE * elapsed and doubt <= LOOSE * left)
    if time > end or left > NEAR * elapsed or not sure:
        return None
    states = np.array([event.x_after for event in marks])
    x = _limit(*states[-3:])
    size = float(np.max(np.abs(states[0]), initial=0.0))
    return ZenoLimit(time, np.where(np.abs(x) <= GONE * size, 0.0, x), ratio)


def _limit(first: Vector, second: Vector, third: Vector) -> Vector:
    """Return the limit of three terms, each component of which approaches it geometrically (Aitken)."""
    before, last = second - first, third - second
    shrinks = np.abs(last) < np.abs(before)
    ratio = np.where(shrinks, last / np.where(before == 0.0, 1.0, before), 0.0)
    return np.asarray(third + last * ratio / (1.0 - ratio))


def _round_length(events: list[Event]) -> int | None:
    """Return the least number of events after which the modes repeat, over `ROUNDS` rounds."""
    modes = [event.mode_after for event in events]
    for length in range(1, min(LONGEST_ROUND, (len(modes) - 1) // ROUNDS) + 1):
        if modes[-1] != modes[-1 - length]:
            continue
        window = modes[-ROUNDS * length :]
        if window == window[:length] * ROUNDS:
            return length
    return None
