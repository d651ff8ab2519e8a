"""Node voltages and element currents as functions of states, multipliers and sources."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs import Exosystem


@dataclass(frozen=True, slots=True, eq=False)
class SourceSignals:
    """(e, e', e'', ...): the values of all sources, then their derivatives.

    Parameters
    ----------
    names : tuple of str
        Names of the sources.
    signal : Exosystem
        e = E w, w' = S w; then e' = E S w.
    derivatives : int
        How many derivatives are wanted.
    """

    names: tuple[str, ...]
    signal: Exosystem
    derivatives: int

    @property
    def output(self) -> Matrix:
        """E, E S, E S**2, ... one below the other, shape ((derivatives + 1) e, p)."""
        powers = [self.signal.output]
        for _ in range(self.derivatives):
            powers.append(powers[-1] @ self.signal.generator)
        return np.vstack(powers)

    def times(self, M: Matrix) -> Exosystem:
        """Return the input M (e, e', ...)."""
        return self.signal.with_output(M @ self.output)

    def after(self, t: float) -> Vector:
        """Return the values just after t, shape ((derivatives + 1) e,)."""
        return np.asarray(self.output @ self.signal.state_after(t))

    def before(self, t: float) -> Vector:
        """Return the values just before t."""
        return np.asarray(self.output @ self.signal.state_before(t))

    def along(self, t: Vector) -> Matrix:
        """Return the values at times in order: before a step where a time comes twice, then after it."""
        steps = (
            np.isin(t, self.signal.knots(float(t[0]), float(t[-1]))) if t.size else np.zeros(0, dtype=bool)
        )
        first = np.zeros(t.size, dtype=bool)
        first[1:-1] = (t[:-2] < t[1:-1]) & (t[1:-1] == t[2:])
        return np.asarray(self.signal.states_along(t, steps & first) @ self.output.T)


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Values of X x + U u + E (e, e', ...), one for each name.

    Parameters
    ----------
    names : tuple of str
        Such as "v(out)" and "i(R1)", or the names of capacitors and inductors for their own states.
    X : Matrix, shape (m, n)
    U : Matrix, shape (m, k)
    E : Matrix, shape (m, sources with derivatives)
    """

    names: tuple[str, ...]
    X: Matrix
    U: Matrix
    E: Matrix

    def __call__(self, x: Matrix, u: Matrix, sources: Matrix) -> Matrix:
        """Return the values, shape (..., m), for x (..., n), u (..., k) and sources (..., e)."""
        return np.asarray(x @ self.X.T + u @ self.U.T + sources @ self.E.T)
