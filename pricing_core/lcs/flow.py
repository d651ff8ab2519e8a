"""The flow in one mode between two events, as a chain of Taylor polynomials."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.closed_form import ClosedForm
from pricing_core.lcs.consistent_pairs import consistent_pairs
from pricing_core.lcs.mode_dynamics import ModeDynamics
from pricing_core.lcs.multipliers import least_norm_multipliers
from pricing_core.lcs.system import LCS

NEGATIVE = 1e-9  # share of an output's terms by which it may be below zero from rounding: it is zero there
LEFT = 1e-14  # the same, of the largest term: what is left of terms that have cancelled
LONGER = 1.0 + 1e-9  # reach of a Taylor polynomial, with rounding


@dataclass(slots=True, eq=False)
class Flow:
    """z(t) = V c(t) from start to end; the coordinates are kept at the start of every step.

    Parameters
    ----------
    form : AutonomousForm
    dynamics : ModeDynamics
    start, end : float
    times : list of float
        The times at which the steps start.
    coordinates : list of Vector, shape (d,)
    largest : float
        Largest of the terms that the state at the start is a sum of.
    closed : ClosedForm, optional
        Of the last step, where that is longer than one Taylor polynomial reaches.
    """

    form: AutonomousForm
    dynamics: ModeDynamics
    start: float
    end: float
    times: list[float] = field(default_factory=list)
    coordinates: list[Vector] = field(default_factory=list)
    largest: float = 0.0
    closed: ClosedForm | None = None

    @property
    def mode(self) -> IndexSet:
        """I."""
        return self.dynamics.mode

    def at(self, t: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """Return x, u and y at times of this flow, shapes (m, n), (m, k), (m, k)."""
        return evaluate((self,), t)

    def coordinates_at(self, t: float) -> Vector:
        """Return the coordinates at a time of this flow, shape (d,)."""
        step = max(bisect_right(self.times, t) - 1, 0)
        elapsed = (t - self.times[step]) * self.form.units.rate
        start = self.coordinates[step][None]
        return np.asarray(_flowed(self.dynamics, self.closed, start, np.array([elapsed]))[0])


def evaluate(flows: Sequence[Flow], t: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at times in any order, right-continuous, shapes (m, n), (m, k), (m, k)."""
    return _in_steps(flows, _steps_at(flows, t), t)


def evaluate_states(flows: Sequence[Flow], t: Vector) -> Matrix:
    """Return x at times in any order, right-continuous, shape (m, n)."""
    form = flows[0].form
    z = np.empty((t.size, form.system.shape[0]))
    for rows, dynamics, c in _by_mode(flows, _steps_at(flows, t), t):
        z[rows] = c @ dynamics.basis.T
    return np.asarray((z * form.units.state)[:, : form.states])


def _steps_at(flows: Sequence[Flow], t: Vector) -> NDArray[np.intp]:
    """Return the steps, counted over all flows, that times lie in."""
    begins = np.concatenate([flow.times for flow in flows])
    return np.maximum(np.searchsorted(begins, t, side="right") - 1, 0)


def evaluate_each(flows: Sequence[Flow], times: Sequence[Vector]) -> tuple[Vector, Matrix, Matrix, Matrix]:
    """Return the times, one after the other, and x, u and y at those of each flow: at an event before and after it."""
    steps, first = [], 0
    for flow, t in zip(flows, times, strict=True):
        steps.append(first + np.maximum(np.array(flow.times).searchsorted(t, side="right") - 1, 0))
        first += len(flow.times)
    together = np.concatenate(times)
    return together, *_in_steps(flows, np.concatenate(steps), together)


def _in_steps(flows: Sequence[Flow], steps: NDArray[np.intp], t: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at times of these steps, counted over all flows; where u is not unique, the least."""
    form = flows[0].form
    n, k = form.system.shape
    z, u, y = (np.empty((t.size, size)) for size in (n, k, k))
    for rows, dynamics, c in _by_mode(flows, steps, t):
        z[rows], u[rows], y[rows] = _values(form.system, dynamics, c)
    pair = form.units.pair
    u, y = least_norm_multipliers(form.given, u * pair, y / pair)
    u, y = consistent_pairs(form.system, z, u / pair, y * pair, t, max(flow.largest for flow in flows))
    return (z * form.units.state)[:, : form.states], u * pair, y / pair


def _by_mode(
    flows: Sequence[Flow], steps: NDArray[np.intp], t: Vector
) -> Iterator[tuple[list[int], ModeDynamics, Matrix]]:
    """Yield for each mode its dynamics, which of the times lie in it, and the coordinates there."""
    starts = [
        (flow, begin, c) for flow in flows for begin, c in zip(flow.times, flow.coordinates, strict=True)
    ]
    rows_of: dict[tuple[int, int], list[int]] = {}
    for row, step in enumerate(steps.tolist()):
        flow = starts[step][0]
        rows_of.setdefault((id(flow.dynamics), id(flow.closed)), []).append(row)
    for rows in rows_of.values():
        held = [starts[step] for step in steps[rows].tolist()]
        flow = held[0][0]
        elapsed = (t[rows] - np.array([begin for _, begin, _ in held])) * flow.form.units.rate
        c = _flowed(flow.dynamics, flow.closed, np.array([c for _, _, c in held]), elapsed)
        yield rows, flow.dynamics, c


def _flowed(dynamics: ModeDynamics, closed: ClosedForm | None, starts: Matrix, elapsed: Vector) -> Matrix:
    """Return the coordinates so long after these starts, in the form's units of time, shape (m, d)."""
    c = dynamics.flowed(starts, np.minimum(elapsed / dynamics.step, LONGER))
    for row in np.flatnonzero(elapsed > LONGER * dynamics.step):
        if closed is not None:
            c[row] = closed.states(starts[row], elapsed[row : row + 1])[0]
        else:
            c[row] = expm(dynamics.rate * elapsed[row]) @ starts[row]
    return c


def _values(system: LCS, dynamics: ModeDynamics, c: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return z, u and y at these coordinates, as functions of them."""
    z, (C, D) = c @ dynamics.basis.T, (system.C, system.D)
    u = np.where(dynamics.active, c @ dynamics.outputs.T, 0.0)
    u = _without_negative_rounding(u, c, dynamics.outputs)
    y = np.where(dynamics.active, 0.0, z @ C.T + u @ D.T)
    y = _without_negative_rounding(y, np.hstack([z, u]), np.hstack([C, D]))
    return z, u, y


def _without_negative_rounding(values: Matrix, terms: Matrix, gains: Matrix) -> Matrix:
    """Return values = terms @ gains.T, those zero that are negative by rounding."""
    sizes, largest = np.abs(terms), np.abs(terms).max(axis=1, initial=0.0)[:, None]
    rounding = (NEGATIVE * sizes + LEFT * largest) @ np.abs(gains).T
    return np.where((values < 0.0) & (values >= -rounding), 0.0, values)
