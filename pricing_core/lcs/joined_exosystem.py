"""Several inputs side by side, each of which starts anew at times of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcs.exosystem import SAME_INSTANT, Exosystem


@dataclass(frozen=True, slots=True, eq=False)
class JoinedExosystem(Exosystem):
    """Several exosystems side by side, each of which starts anew at times of its own.

    Parameters
    ----------
    parts : sequence of Exosystem
        Their states one after the other are w.
    output : array_like, shape (m, p)
        E, of all of them.

    Examples
    --------
    A constant, and a square wave between 0 and 1 of period 2:

    >>> square = Exosystem([[0.0]], [[1.0]], [[0.0], [1.0], [0.0]], times=[-1.0, 0.0, 1.0], period=2.0)
    >>> both = JoinedExosystem([Exosystem([[0.0]], [[1.0]], [5.0]), square], [[1.0, 1.0]])
    >>> both.after(2.5), both.after(3.5), both.knots(0.0, 4.5)
    (array([6.]), array([5.]), array([1., 2., 3., 4.]))
    """

    parts: tuple[Exosystem, ...]

    def __init__(self, parts: Sequence[Exosystem], output: ArrayLike) -> None:
        if not isinstance(parts, list | tuple) or not parts:
            raise InvalidInputError("parts", parts, "a list of exosystems, one or more")
        for i, part in enumerate(parts):
            if not isinstance(part, Exosystem):
                raise InvalidInputError(f"parts[{i}]", Told(type(part).__name__), "an Exosystem")
        start = min(float(part.times[0]) for part in parts)
        states = np.concatenate([part.state_after(start) for part in parts])
        Exosystem.__init__(self, block_diag(*(part.generator for part in parts)), output, states, (start,))
        object.__setattr__(self, "parts", tuple(parts))

    def with_output(self, output: Matrix) -> Exosystem:
        """Return the same w seen through another matrix E, shape (m, p)."""
        return JoinedExosystem(self.parts, output)

    def shares_states_with(self, other: Exosystem) -> bool:
        """Tell whether both have the same w."""
        return isinstance(other, JoinedExosystem) and (
            self.parts == other.parts
            or (
                len(self.parts) == len(other.parts)
                and all(
                    one.shares_states_with(another)
                    for one, another in zip(self.parts, other.parts, strict=True)
                )
            )
        )

    @property
    def jumps(self) -> Vector:
        """The times at which w starts anew, those of the first period of each part."""
        return np.unique(np.concatenate([part.jumps for part in self.parts]))

    def knots(self, t0: float, t1: float) -> Vector:
        """Return the times strictly between `t0` and `t1` at which w starts anew.

        Times of two exosystems that only rounding tells apart are returned once.
        """
        periods = [part.period for part in self.parts if part.period is not None]
        found = np.concatenate([part.knots(t0, t1) for part in self.parts])
        return distinct(found, SAME_INSTANT * min(periods, default=0.0))

    def states_along(self, t: Vector, before: BoolVector) -> Matrix:
        """Return w just after each of the times `t`, or just before it where `before` is True, shape (m, p)."""
        return np.hstack([part.states_along(t, before) for part in self.parts])


def distinct(times: Vector, close: float) -> Vector:
    """Return the times in order, the first of each few that are no farther apart than `close`, or rounding.

    Examples
    --------
    >>> distinct(np.array([2.0, 0.1 + 0.2, 0.3]), 0.0)
    array([0.3, 2. ])
    """
    ordered = np.unique(times)
    if not ordered.size:
        return ordered
    apart = np.diff(ordered) > np.maximum(close, 4.0 * np.spacing(np.abs(ordered[1:])))
    return np.asarray(ordered[np.concatenate([[True], apart])])
