"""Inputs that a linear system of their own generates: sines, ramps, polynomials, and pieces of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from pricing_core.arrays import (
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

    def __init__(
        self, generator: ArrayLike, output: ArrayLike, states: ArrayLike, times: ArrayLike = (0.0,)
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
        for name, value in (("generator", S), ("output", E), ("states", w), ("times", knots)):
            object.__setattr__(self, name, value)

    @property
    def size(self) -> int:
        """The number m of components."""
        return int(self.output.shape[0])

    @property
    def jumps(self) -> Vector:
        """The times at which w starts anew."""
        return self.times[1:]

    def state_after(self, t: float) -> Vector:
        """Return w just after t, shape (p,)."""
        return self._state(t, int(np.searchsorted(self.times, as_number("t", t), side="right")) - 1)

    def after(self, t: float) -> Vector:
        """Return the value just after t, shape (m,)."""
        return np.asarray(self.output @ self.state_after(t))

    def given_after(self, t: float) -> Vector:
        """Return the value just after t, as exact arithmetic takes it: the rounded one, shape (m,)."""
        return self.after(t)

    def before(self, t: float) -> Vector:
        """Return the value just before t, shape (m,)."""
        return np.asarray(
            self.output @ self._state(t, int(np.searchsorted(self.times, as_number("t", t), side="left")) - 1)
        )

    def _state(self, t: float, piece: int) -> Vector:
        piece = max(piece, 0)
        elapsed = t - float(self.times[piece])
        if elapsed == 0.0:
            return np.asarray(self.states[piece])
        with np.errstate(over="ignore", invalid="ignore"):
            state = np.asarray(expm(self.generator * elapsed) @ self.states[piece])
        if not np.isfinite(state).all():
            raise NumericalError(f"the input overflows at t = {t:.12g}")
        return state


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
