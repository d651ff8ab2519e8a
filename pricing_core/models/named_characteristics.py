"""Characteristics with a name: saturation, dead zone, relay, friction, diode, resistor, gain schedule."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import as_increasing, as_number, as_vector
from pricing_core.errors import InvalidInputError
from pricing_core.models.characteristic import Characteristic

CONNECTED = 1e-12  # relative: pieces whose ends are closer meet


def saturation(gain: float = 1.0, limit: float = 1.0) -> Characteristic:
    """Return u = gain y where |u| <= limit, and no more than the limit beyond.

    Examples
    --------
    >>> saturation(2.0, 3.0)([1.0, -5.0])
    array([ 2., -3.])
    """
    gain = _positive("gain", gain)
    limit = _positive("limit", limit)
    return Characteristic([(-limit / gain, -limit), (limit / gain, limit)])


def dead_zone(width: float = 1.0, gain: float = 1.0) -> Characteristic:
    """Return u = 0 where |y| <= width, with the slope `gain` beyond.

    Examples
    --------
    >>> dead_zone()([-3.0, 0.5])
    array([-2.,  0.])
    """
    width = _positive("width", width)
    gain = _positive("gain", gain)
    return Characteristic([(-width, 0.0), (width, 0.0)], gain, gain)


def relay_step(lower: float = -1.0, upper: float = 1.0) -> Characteristic:
    """Return the relay u = upper for y < 0, u = lower for y > 0, and all between at y = 0."""
    lower = as_number("lower", lower)
    upper = as_number("upper", upper)
    if not lower < upper:
        raise InvalidInputError("lower", lower, f"less than upper = {upper:g}")
    return Characteristic([(0.0, upper), (0.0, lower)])


def coulomb_friction(level: float = 1.0, viscosity: float = 0.0) -> Characteristic:
    """Return the force u = -level sgn y - viscosity y against the velocity y, |u| <= level at rest.

    Examples
    --------
    >>> coulomb_friction(2.0, 0.5).points.tolist(), coulomb_friction(2.0, 0.5).right_slope
    ([[0.0, 2.0], [0.0, -2.0]], -0.5)
    """
    level = _positive("level", level)
    viscosity = as_number("viscosity", viscosity)
    if not viscosity >= 0.0:
        raise InvalidInputError("viscosity", viscosity, ">= 0")
    return Characteristic([(0.0, level), (0.0, -level)], -viscosity, -viscosity)


def ideal_diode() -> Characteristic:
    """Return y >= 0, u >= 0 with y u = 0: the complementarity conditions themselves."""
    return Characteristic([(0.0, 0.0)], -math.inf, 0.0)


def resistor(
    voltages: ArrayLike, currents: ArrayLike, left_conductance: float, right_conductance: float
) -> Characteristic:
    """Return the current u through a piecewise linear resistor at the voltage y.

    Parameters
    ----------
    voltages, currents : array_like, shape (m,)
        Voltages and currents at the corners; the voltages must not decrease. Equal ones make a source of that
        voltage (a Zener diode).
    left_conductance, right_conductance : float
        Conductances beyond the first and the last corner.

    Examples
    --------
    A tunnel diode, whose current falls between 1 and 2:

    >>> resistor([1.0, 2.0], [2.0, 1.0], 2.0, 1.0)([0.5, 1.5, 3.0])
    array([1. , 1.5, 2. ])
    """
    at = as_vector("voltages", voltages)
    through = as_vector("currents", currents, at.size)
    for j in np.flatnonzero(np.diff(at) < 0.0).tolist():
        raise InvalidInputError(f"voltages[{j + 1}]", float(at[j + 1]), f"at least voltages[{j}] = {at[j]:g}")
    return Characteristic(np.column_stack([at, through]), left_conductance, right_conductance)


def gain_schedule(
    thresholds: ArrayLike, gains: ArrayLike, offsets: ArrayLike | None = None
) -> Characteristic:
    """Return u = gains[j] y + offsets[j] from thresholds[j - 1] to thresholds[j].

    Parameters
    ----------
    thresholds : array_like, shape (m,)
        Increasing.
    gains : array_like, shape (m + 1,)
    offsets : array_like, shape (m + 1,), optional
        Without them the pieces are joined into the continuous function with u(0) = 0.

    Raises
    ------
    InvalidInputError
        Thresholds that do not increase, pieces with given offsets that do not meet at a threshold.

    Examples
    --------
    >>> gain_schedule([-1.0, 1.0], [5.0, 1.0, 5.0])([0.5, 2.0])
    array([0.5, 6. ])
    """
    at = as_increasing("thresholds", thresholds)
    slopes = as_vector("gains", gains, at.size + 1)
    if offsets is None:
        joined = np.concatenate([[0.0], np.cumsum((slopes[:-1] - slopes[1:]) * at)])
        shift = joined - joined[int(np.searchsorted(at, 0.0))]
    else:
        shift = as_vector("offsets", offsets, slopes.size)
    ends, starts = slopes[:-1] * at + shift[:-1], slopes[1:] * at + shift[1:]
    size = (
        np.maximum(np.abs(slopes[:-1] * at), np.abs(slopes[1:] * at)) + np.abs(shift[:-1]) + np.abs(shift[1:])
    )
    for j in np.flatnonzero(np.abs(ends - starts) > CONNECTED * size).tolist():
        raise InvalidInputError(
            f"offsets[{j + 1}]",
            float(shift[j + 1]),
            f"such that the pieces meet at thresholds[{j}] = {at[j]:g}: there u = {ends[j]:g} and {starts[j]:g}",
        )
    return Characteristic(np.column_stack([at, ends]), float(slopes[0]), float(slopes[-1]))


def _positive(name: str, value: float) -> float:
    number = as_number(name, value)
    if not number > 0.0:
        raise InvalidInputError(name, value, "a finite number > 0")
    return number
