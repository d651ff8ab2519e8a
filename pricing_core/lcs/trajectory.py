"""A simulated trajectory: states, multipliers, slacks and events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pricing_core.arrays import IndexSet, Matrix, Vector, as_real_array, as_whole_number
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.flow import Flow, evaluate_each, evaluate_states, flow_of_each
from pricing_core.lcs.run_table import named_columns, table_of
from pricing_core.lcs.system import LCS
from pricing_core.lcs.uniqueness import has_unique_state

if TYPE_CHECKING:
    import pyarrow

MOST_POINTS = 10_000_000
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
EventKind = Literal["switch", "jump", "input", "grazing", "zeno"]


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """What happens at one instant.

    Parameters
    ----------
    time : float
    kind : {"switch", "jump", "input", "grazing", "zeno"}
        A change of mode with a continuous state; a jump of the state; a change of the input alone; an output that
        touches zero without crossing it; the limit of infinitely many events.
    x_before, x_after : Vector, shape (n,)
    impulse : Vector, shape (k,)
        Coefficients of delta in u; zero but for "jump".
    mode_before, mode_after : tuple of int, or None
        The pairs with y_i = 0; None where time stepping does not tell, before the start, and behind an unknown limit.
    multiplicity : int
        How often the state is reinitialised at this instant (11.78): 0 where it is continuous.
    energy_lost : float or None
        x_before^T Q x_before / 2 less the same afterwards, with a storage function Q of a passive system.
    order_sensitive : bool
        Several constraints become active together, and the state afterwards would be another if they did so one
        after the other, in one order at least (section 11.8).
    ratio : float or None
        Length of each round of events over that of the one before, of a "zeno" event.
    """

    time: float
    kind: EventKind
    x_before: Vector
    x_after: Vector
    impulse: Vector
    mode_before: IndexSet | None = None
    mode_after: IndexSet | None = None
    multiplicity: int = 0
    energy_lost: float | None = None
    order_sensitive: bool = False
    ratio: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """The state x(t), u(t) and y(t) at the times of the steps, or at `t_eval` where that was given.

    Calling it gives x, right-continuous: exactly as it flows where the run was driven by events, linear between
    stored times where it stepped. Without `t_eval` the time of an event is stored twice, before and after.

    Parameters
    ----------
    t : Vector, shape (m,)
    x : Matrix, shape (m, n)
    u, y : Matrix, shape (m, k)
    events : tuple of Event
    status : {"finished", "interrupted"}
    scheme : str
        "event-driven", or the one-step method that was used.
    accepted, rejected, forced : int
        Step counters, see `pricing_core.stepping.Integration`.
    system : LCS or None
        The system whose solution this is to rounding; None where the run stepped, or went by another law of impact.
    flows : tuple of Flow
        The exact solution between events, where the run was driven by events.
    flow_of : ndarray of int, shape (m,), or None
        Index of the flow that each row belongs to.
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
    system: LCS | None = field(default=None, repr=False)
    flows: tuple[Flow, ...] = field(default=(), repr=False)
    flow_of: NDArray[np.intp] | None = field(default=None, repr=False)  # (m,): which flow each row belongs to

    @property
    def unique(self) -> Literal[True] | None:
        """True where it is proved, for the system as given, that no state has another continuation; else None.

        Exact, see `has_unique_state`: some milliseconds when it is asked for first. None where `system` is.
        """
        return None if self.system is None else has_unique_state(self.system)

    def __call__(self, t: ArrayLike) -> Matrix:
        """Return x(t), shape (n,) for a scalar, (len(t), n) for a vector.

        Raises
        ------
        InvalidInputError
            t lies outside the simulated interval.
        """
        wanted = as_real_array("t", t)
        start, end = (self.flows[0].start, self.flows[-1].end) if self.flows else (self.t[0], self.t[-1])
        if not np.all((wanted >= start) & (wanted <= end)):
            raise InvalidInputError("t", t, f"inside [{start:g}, {end:g}]")
        if self.flows:
            x = evaluate_states(self.flows, wanted.ravel())
            return x.reshape(*wanted.shape, x.shape[1])
        if self.t.size == 1:
            return np.broadcast_to(self.x[0], (*wanted.shape, self.x.shape[1])).copy()
        right = np.clip(np.searchsorted(self.t, wanted, side="right"), 1, self.t.size - 1)
        left = right - 1
        width = self.t[right] - self.t[left]
        weight = np.where(width > 0.0, (wanted - self.t[left]) / np.where(width > 0.0, width, 1.0), 1.0)[
            ..., None
        ]
        return np.asarray((1.0 - weight) * self.x[left] + weight * self.x[right])

    def to_table(
        self,
        *,
        states: Sequence[str] | None = None,
        multipliers: Sequence[str] | None = None,
        slacks: Sequence[str] | None = None,
    ) -> pyarrow.Table:
        """Return the run as a `pyarrow.Table` of m rows: t, and a column for each component of x, u and y.

        Parameters
        ----------
        states, multipliers, slacks : sequence of str, optional
            Names of the columns; x1, ..., u1, ..., y1, ... where missing.

        Raises
        ------
        InvalidInputError
            Names that are not one for each column, or not different.
        MissingExtraError
            pyarrow, of the extra "batch", is not installed.

        Examples
        --------
        >>> one = np.ones((1, 1))
        >>> run = Trajectory(np.zeros(1), np.ones((1, 2)), 0 * one, one, (), "finished", "", 0, 0, 0)
        >>> run.to_table(states=["voltage", "current"]).column_names
        ['t', 'voltage', 'current', 'u1', 'y1']
        """
        return table_of(named_columns(self.t, self._parts(states, multipliers, slacks)))

    def _parts(
        self, states: Sequence[str] | None, multipliers: Sequence[str] | None, slacks: Sequence[str] | None
    ) -> list[tuple[str, str, NDArray[np.float64], Sequence[str] | None]]:
        """Return what `named_columns` takes."""
        return [
            ("states", "x", self.x, states),
            ("multipliers", "u", self.u, multipliers),
            ("slacks", "y", self.y, slacks),
        ]

    def refined(self, count: int) -> Trajectory:
        """Return the run at `count` times or somewhat more, evenly over the interval, and at each event twice.

        Where it stepped nothing is known between the steps, and the trajectory itself is returned.
        """
        points = as_whole_number("count", count, 1, MOST_POINTS)
        if not self.flows:
            return self
        spacing = (self.flows[-1].end - self.flows[0].start) / points
        times = [
            np.linspace(flow.start, flow.end, math.ceil((flow.end - flow.start) / spacing) + 1)
            for flow in self.flows
        ]
        t, x, u, y = evaluate_each(self.flows, times)
        return replace(self, t=t, x=x, u=u, y=y, flow_of=flow_of_each(times))

    def quadrature(self) -> tuple[Trajectory, Vector]:
        """Return the run at the nodes of a quadrature over its interval, and their weights, whose sum is 1.

        Gauss's rule of 12 nodes on every step: exact to rounding for products of two outputs where the run was driven
        by events. Where it stepped, the trapezoidal rule on the times stored.
        """
        if not self.flows:
            widths = np.diff(self.t)
            weights = np.concatenate([widths, [0.0]]) + np.concatenate([[0.0], widths])
            return self, weights / max(float(weights.sum()), 1e-300)
        times, shares = [], []
        for flow in self.flows:
            marks = flow.marks()
            middle, half = (marks[1:] + marks[:-1]) / 2.0, np.diff(marks) / 2.0
            times.append((middle[:, None] + half[:, None] * NODES).ravel())
            shares.append((half[:, None] * WEIGHTS).ravel())
        t, x, u, y = evaluate_each(self.flows, times)
        weights = np.concatenate(shares)
        run = replace(self, t=t, x=x, u=u, y=y, flow_of=flow_of_each(times))
        return run, weights / weights.sum()
