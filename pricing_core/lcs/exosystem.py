"""Inputs that a linear system of their own generates: sines, ramps, polynomials, and pieces of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from pricing_core.arrays import (
    BoolVector,
    Matrix,
    Vector,
    as_array,
    as_increasing,
    as_matrix,
    as_number,
    as_real_array,
    as_square_matrix,
    as_vector,
)
from pricing_core.errors import InvalidInputError, NumericalError

SAME_INSTANT = 1e-12  # of a period: how closely its times are told apart


@dataclass(frozen=True, slots=True, eq=False)
class Exosystem:
    """E w(t) with w' = S w, and w(times[i]) = states[i] anew at every time.

    Before the first of the times w follows the same equation backwards from there.

    Parameters
    ----------
    generator : array_like, shape (p, p)
        S.
    output : array_like, shape (m, p)
        E.
    states : array_like, shape (r, p) or (p,)
        w just after each of the times.
    times : array_like, shape (r,), optional
        Increasing; 0 where missing.
    period : float, optional
        From the second of the times on, w starts anew at all times[i] + j period, j = 0, 1, ....

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite, times that do not increase.

    Examples
    --------
    A ramp that starts again at t = 2:

    >>> saw = Exosystem([[0, 1], [0, 0]], [[1, 0]], [[0, 0.5], [0, 0.5]], times=[0, 2])
    >>> saw.after(1.0), saw.before(2.0), saw.after(2.0)
    (array([0.5]), array([1.]), array([0.]))
    """

    generator: Matrix  # (p, p)
    output: Matrix  # (m, p)
    states: Matrix  # (r, p)
    times: Vector  # (r,)
    period: float | None

    def __init__(
        self,
        generator: ArrayLike,
        output: ArrayLike,
        states: ArrayLike,
        times: ArrayLike = (0.0,),
        *,
        period: float | None = None,
    ) -> None:
        S = as_square_matrix("generator", generator)
        rows = as_array("states", states)
        w = as_matrix("states", rows[None, :] if rows.ndim == 1 else rows)
        knots = as_increasing("times", times)
        if w.shape != (knots.size, S.shape[0]):
            allowed = f"one row of {S.shape[0]} numbers for each of the {knots.size} times"
            raise InvalidInputError("states", f"shape {w.shape}", allowed)
        E = as_matrix("output", output)
        if E.shape[1] != S.shape[0]:
            raise InvalidInputError("output", f"{E.shape[1]} columns", f"{S.shape[0]} columns")
        if period is not None:
            length = float(knots[-1] - knots[min(1, knots.size - 1)])
            if knots.size < 2 or not as_number("period", period) > length:
                raise InvalidInputError(
                    "period", period, f"longer than the times that are repeated, {length:g}"
                )
        for name, value in (("generator", S), ("output", E), ("states", w), ("times", knots)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "period", period)

    def with_output(self, output: Matrix) -> Exosystem:
        """Return the same w seen through another matrix E, shape (m, p)."""
        return Exosystem(self.generator, output, self.states, self.times, period=self.period)

    def shares_states_with(self, other: Exosystem) -> bool:
        """Tell whether this exosystem and the `other` one have the same w."""
        pairs = ((self.generator, other.generator), (self.states, other.states), (self.times, other.times))
        same = all(np.array_equal(one, another) for one, another in pairs)
        return same and self.period == other.period

    @property
    def size(self) -> int:
        """The number m of components."""
        return int(self.output.shape[0])

    @property
    def jumps(self) -> Vector:
        """The times at which w starts anew, those of the first period where they repeat."""
        return self.times[1:]

    def knots(self, t0: float, t1: float) -> Vector:
        """Return the times strictly between `t0` and `t1` at which w starts anew."""
        found = self.times[1:]
        if self.period is not None and found.size:
            first = max(math.floor((t0 - float(found[-1])) / self.period), 0)
            last = max(math.ceil((t1 - float(found[0])) / self.period), first)
            found = (np.arange(first, last + 1)[:, None] * self.period + found).ravel()
        return found[(found > t0) & (found < t1)]

    def state_after(self, t: float) -> Vector:
        """Return w just after t, shape (p,)."""
        return np.asarray(self.states_along(np.array([as_number("t", t)]), np.array([False]))[0])

    def state_before(self, t: float) -> Vector:
        """Return w just before t, shape (p,)."""
        return np.asarray(self.states_along(np.array([as_number("t", t)]), np.array([True]))[0])

    def states_along(self, t: Vector, before: BoolVector) -> Matrix:
        """Return w just after each of the times, or just before it, shape (m, p)."""
        pieces, elapsed = self._pieces(t, before)
        starts = self.states[pieces]
        slopes = starts @ self.generator.T
        with np.errstate(over="ignore", invalid="ignore"):
            found = starts + elapsed[:, None] * slopes  # a constant, or a ramp
            curved = (elapsed != 0.0) & (slopes @ self.generator.T).any(axis=1)
            for row in np.flatnonzero(curved) if not self._turns else ():
                found[row] = expm(self.generator * elapsed[row]) @ starts[row]
            if self._turns and curved.any():
                omega = float(self.generator[0, 1])
                angles = omega * elapsed[curved, None]
                found[curved] = starts[curved] * np.cos(angles) + slopes[curved] * (np.sin(angles) / omega)
        for row in np.flatnonzero(~np.isfinite(found).all(axis=1)):
            raise NumericalError(f"the input overflows at t = {t[row]:.12g}")
        return found

    @property
    def _turns(self) -> bool:
        """Whether w goes round in a circle."""
        S = self.generator
        return S.shape == (2, 2) and S[0, 1] != 0.0 and S[1, 0] == -S[0, 1] and not np.diag(S).any()

    def _pieces(self, t: Vector, before: BoolVector) -> tuple[NDArray[np.intp], Vector]:
        """Return which of the states each of the times follows, and after how long."""
        if self.period is None:
            sides = (np.searchsorted(self.times, t, side=side) for side in ("left", "right"))
            pieces = np.maximum(np.where(before, *sides) - 1, 0)
            return pieces, t - self.times[pieces]
        close = np.maximum(SAME_INSTANT * self.period, 4.0 * np.spacing(np.abs(t)))
        looked = np.where(before, t - close, t + close)
        turns = np.maximum(np.floor((looked - self.times[1]) / self.period), 0.0)
        pieces = np.searchsorted(self.times, looked - turns * self.period, side="right") - 1
        elapsed = t - turns * self.period - self.times[np.maximum(pieces, 0)]
        return np.maximum(pieces, 0), np.where(pieces >= 0, np.maximum(elapsed, 0.0), elapsed)

    def after(self, t: float) -> Vector:
        """Return the value just after t, shape (m,)."""
        return np.asarray(self.output @ self.state_after(t))

    def given_after(self, t: float) -> Vector:
        """Return the value just after t, as exact arithmetic takes it: the rounded one, shape (m,)."""
        return self.after(t)

    def before(self, t: float) -> Vector:
        """Return the value just before t, shape (m,)."""
        return np.asarray(self.output @ self.state_before(t))


def pulses(
    low: float,
    high: float,
    period: float,
    width: float,
    rise: float = 0.0,
    fall: float = 0.0,
    delay: float = 0.0,
) -> Exosystem:
    """Return a train of trapezoidal pulses: low up to `delay`, then high for `width` in every period.

    Parameters
    ----------
    rise, fall : float
        How long the ramps take, which lie before and after `width`; 0 for a step.

    Examples
    --------
    >>> train = pulses(0.0, 5.0, period=10.0, width=4.0, rise=1.0, fall=1.0)
    >>> [train.after(t).item() for t in (-1.0, 0.5, 3.0, 5.5, 8.0, 13.0)]
    [0.0, 2.5, 5.0, 2.5, 0.0, 5.0]
    """
    read = {
        "low": low,
        "high": high,
        "period": period,
        "width": width,
        "rise": rise,
        "fall": fall,
        "delay": delay,
    }
    low, high, period, width, rise, fall, delay = (as_number(name, value) for name, value in read.items())
    for name, value in (("width", width), ("rise", rise), ("fall", fall)):
        if value < 0.0:
            raise InvalidInputError(name, value, ">= 0")
    if not rise + width + fall < period:
        raise InvalidInputError(
            "period", period, f"longer than rise, width and fall, {rise + width + fall:g}"
        )
    corners = [(delay - period, low, 0.0)]
    for lasts, start, slope in (
        (rise, low, high - low),
        (width, high, 0.0),
        (fall, high, low - high),
        (period, low, 0.0),
    ):
        if lasts > 0.0:
            corners.append((delay, start, slope / lasts))
        delay += lasts
    times, values, slopes = np.array(corners).T
    return Exosystem([[0, 1], [0, 0]], [[1, 0]], np.column_stack([values, slopes]), times, period=period)


def sine(amplitude: ArrayLike, frequency: float, phase: float = 0.0, offset: ArrayLike = 0.0) -> Exosystem:
    """Return offset + amplitude sin(2 pi frequency t + phase).

    Parameters
    ----------
    amplitude, offset : array_like, shape (m,), or float
    frequency : float
        Per unit of time: hertz where t is in seconds.
    phase : float
        Radians.

    Examples
    --------
    >>> sine(325.0, frequency=50.0).after(0.005)
    array([325.])
    """
    amplitudes = np.atleast_1d(as_real_array("amplitude", amplitude))
    levels = np.atleast_1d(as_real_array("offset", offset))
    sizes = as_vector("amplitude", amplitudes, levels.size if amplitudes.size > 1 < levels.size else None)
    sizes, offsets = np.broadcast_arrays(sizes, as_vector("offset", levels))
    omega, start = 2.0 * math.pi * as_number("frequency", frequency), as_number("phase", phase)
    generator = [[0.0, omega, 0.0], [-omega, 0.0, 0.0], [0.0, 0.0, 0.0]]
    output = np.column_stack([sizes, np.zeros(sizes.size), offsets])
    return Exosystem(generator, output, [math.sin(start), math.cos(start), 1.0])


def piecewise_linear(times: ArrayLike, values: ArrayLike) -> Exosystem:
    """Return the continuous polyline through (times[i], values[i]), constant before the first and after the last.

    Parameters
    ----------
    times : array_like, shape (r,)
        Increasing.
    values : array_like, shape (r, m) or (r,)

    Examples
    --------
    >>> polyline = piecewise_linear([0.0, 1.0, 3.0], [0.0, 2.0, 0.0])
    >>> [polyline.after(t).item() for t in (-1.0, 0.5, 2.0, 9.0)]
    [0.0, 1.0, 1.0, 0.0]
    """
    knots = as_increasing("times", times)
    rows = as_array("values", values)
    table = as_matrix("values", rows[:, None] if rows.ndim == 1 else rows)
    if table.shape[0] != knots.size:
        raise InvalidInputError(
            "values", f"{table.shape[0]} rows", f"one row for each of the {knots.size} times"
        )
    m = table.shape[1]
    still = np.zeros((1, m))
    slopes = np.vstack([still, np.diff(table, axis=0) / np.diff(knots)[:, None], still])
    start = float(knots[0]) - 1.0  # before the first: at rest there
    states = np.hstack([np.vstack([table[:1], table]), slopes])
    generator = np.block([[np.zeros((m, m)), np.eye(m)], [np.zeros((m, 2 * m))]])
    output = np.hstack([np.eye(m), np.zeros((m, m))])
    return Exosystem(generator, output, states, np.concatenate([[start], knots]))
