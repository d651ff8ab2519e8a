"""The linear complementarity system and its piecewise constant inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import (
    Matrix,
    Vector,
    as_array,
    as_increasing,
    as_matrix,
    as_number,
    as_square_matrix,
    as_vector,
)
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.exosystem import Exosystem


@dataclass(frozen=True, slots=True, eq=False)
class PiecewiseConstant:
    """A vector that changes only at given times: values[i] holds up to times[i], the last one for ever.

    Parameters
    ----------
    times : array_like, shape (m,)
        Increasing.
    values : array_like, shape (m, n) or (m,)

    Examples
    --------
    >>> step = PiecewiseConstant([1.0, 2.0], [[0.0], [5.0]])
    >>> step.after(0.5), step.after(1.0), step.after(9.0)
    (array([0.]), array([5.]), array([5.]))
    """

    times: Vector  # (m,)
    values: Matrix  # (m, n)
    given: NDArray[Any]  # (m, n): the values as given, for exact arithmetic

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        knots = as_increasing("times", times)
        rows = as_array("values", values)
        rows = rows[:, None] if rows.ndim == 1 else rows
        table = as_matrix("values", rows)
        if table.shape[0] != knots.size:
            raise InvalidInputError(
                "values", f"{table.shape[0]} rows", f"one row for each of the {knots.size} times"
            )
        object.__setattr__(self, "times", knots)
        object.__setattr__(self, "values", table)
        object.__setattr__(self, "given", _as_given(rows, table))

    @property
    def size(self) -> int:
        """The number n of components."""
        return int(self.values.shape[1])

    def after(self, t: float) -> Vector:
        """Return the value that holds just after t, shape (n,)."""
        return np.asarray(self.values[self._piece_after(t)])

    def given_after(self, t: float) -> NDArray[Any]:
        """Return the value that holds just after t as it was given, shape (n,)."""
        return np.asarray(self.given[self._piece_after(t)])

    def before(self, t: float) -> Vector:
        """Return the value that holds just before t, shape (n,)."""
        if self.times.size == 1:
            return np.asarray(self.values[0])
        moment = as_number("t", t)
        index = min(int(np.searchsorted(self.times, moment, side="left")), self.times.size - 1)
        return np.asarray(self.values[index])

    @property
    def jumps(self) -> Vector:
        """The times at which the value changes."""
        return self.times[:-1]

    def knots(self, t0: float, t1: float) -> Vector:
        """Return the times strictly between `t0` and `t1` at which the value changes."""
        return self.jumps[(self.jumps > t0) & (self.jumps < t1)]

    def _piece_after(self, t: float) -> int:
        moment = as_number("t", t)
        if self.times.size == 1:
            return 0
        return min(int(np.searchsorted(self.times, moment, side="right")), self.times.size - 1)


@dataclass(frozen=True, slots=True, eq=False)
class LCS:
    """x' = Ax + Bu + f, y = Cx + Du + g, 0 <= y _|_ u >= 0 (11.69), with inputs f and g.

    Entries may be `Fraction`: simulation rounds them, the exact methods take them as they are, and every
    float for the rational number that `pricing_core.linalg.rational.rational` states.

    Parameters
    ----------
    A : array_like, shape (n, n)
    B : array_like, shape (n, k)
    C : array_like, shape (k, n)
    D : array_like, shape (k, k), optional
        Zero where missing.
    f, g : array_like of shape (n,) and (k,), PiecewiseConstant or Exosystem, optional
        Zero where missing.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries that are not finite.

    Examples
    --------
    >>> LCS([[-1.0]], [[1.0]], [[1.0]]).shape
    (1, 1)
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    f: PiecewiseConstant | Exosystem
    g: PiecewiseConstant | Exosystem
    given: tuple[NDArray[Any], ...]  # A, B, C, D as given, for exact arithmetic

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike | None = None,
        f: ArrayLike | PiecewiseConstant | Exosystem | None = None,
        g: ArrayLike | PiecewiseConstant | Exosystem | None = None,
    ) -> None:
        state = as_square_matrix("A", A)
        n = state.shape[0]
        k = as_matrix("B", B).shape[1]
        object.__setattr__(self, "A", state)
        object.__setattr__(self, "B", as_matrix("B", B, (n, k)))
        object.__setattr__(self, "C", as_matrix("C", C, (k, n)))
        object.__setattr__(self, "D", as_matrix("D", np.zeros((k, k)) if D is None else D, (k, k)))
        pairs = ((A, self.A), (B, self.B), (C, self.C), (self.D if D is None else D, self.D))
        object.__setattr__(self, "given", tuple(_as_given(raw, matrix) for raw, matrix in pairs))
        object.__setattr__(self, "f", _as_input("f", f, n))
        object.__setattr__(self, "g", _as_input("g", g, k))

    @property
    def shape(self) -> tuple[int, int]:
        """(n, k): the number of states and of complementary pairs."""
        return self.B.shape[0], self.B.shape[1]


def _as_input(
    field: str, value: ArrayLike | PiecewiseConstant | Exosystem | None, size: int
) -> PiecewiseConstant | Exosystem:
    if isinstance(value, PiecewiseConstant | Exosystem):
        if value.size != size:
            raise InvalidInputError(field, f"{value.size} components", f"{size} components")
        return value
    constant = np.zeros(size) if value is None else as_array(field, value)
    as_vector(field, constant, size)
    return PiecewiseConstant([0.0], constant[None, :])


def _as_given(raw: ArrayLike, rounded: Matrix) -> NDArray[Any]:
    """Return the array of floats, or a copy of the integers and fractions that were given in its place."""
    entries = np.asarray(raw)
    if entries.dtype.kind == "f":
        return rounded
    own = np.array(entries)
    if own.dtype.kind == "O":
        own.ravel()[:] = [entry.item() if isinstance(entry, np.number) else entry for entry in own.ravel()]
    own.flags.writeable = False
    return own
