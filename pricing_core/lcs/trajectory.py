"""A simulated trajectory: states, multipliers, slacks and events."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """A jump of the state, or a change of the input that leaves the state continuous.

    Parameters
    ----------
    time : float
    kind : {"jump", "input"}
    x_before, x_after : Vector, shape (n,)
    impulse : Vector, shape (k,)
        Coefficients of delta in u; zero for "input".
    """

    time: float
    kind: Literal["jump", "input"]
    x_before: Vector
    x_after: Vector
    impulse: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """x(t), u(t), y(t) at the times of the steps, or at `t_eval` where that was given.

    Calling it gives x, right-continuous, linear between stored times. At a jump inside the interval the time
    is stored twice, before and after; `t[0]` holds the state after a jump at the start.

    Parameters
    ----------
    t : Vector, shape (m,)
    x : Matrix, shape (m, n)
    u, y : Matrix, shape (m, k)
    events : tuple of Event
    status : {"finished", "interrupted"}
    scheme : str
        The one-step method that was used.
    accepted, rejected, forced : int
        Step counters, see `pricing_core.stepping.Integration`.
    """

    t: Vector
    x: Matrix
    u: Matrix
    y: Matrix
    events: tuple[Event, ...]
    status: Literal["finished", "interrupted"]
    scheme: str
    accepted: int
    rejected: int
    forced: int

    def __call__(self, t: ArrayLike) -> Matrix:
        """Return x(t), shape (n,) for a scalar, (len(t), n) for a vector.

        Raises
        ------
        InvalidInputError
            t lies outside the simulated interval.
        """
        wanted = np.asarray(t, dtype=np.float64)
        if not np.all((wanted >= self.t[0]) & (wanted <= self.t[-1])):
            raise InvalidInputError("t", t, f"inside [{self.t[0]:g}, {self.t[-1]:g}]")
        right = np.clip(np.searchsorted(self.t, wanted, side="right"), 1, max(1, self.t.size - 1))
        if self.t.size == 1:
            return np.broadcast_to(self.x[0], (*wanted.shape, self.x.shape[1])).copy()
        left = right - 1
        width = self.t[right] - self.t[left]
        weight = np.where(width > 0.0, (wanted - self.t[left]) / np.where(width > 0.0, width, 1.0), 1.0)[
            ..., None
        ]
        return np.asarray((1.0 - weight) * self.x[left] + weight * self.x[right])
