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
        The closed form of the last step, where that is longer than one Taylor polynomial reaches.
    final : Vector, shape (d,), optional
        The coordinates at the end, where they are known.
    falls : Vector, shape (d,), optional
        What becomes negative where the flow ends, as a function of the coordinates; none where its end is given.
    """

    form: AutonomousForm
    dynamics: ModeDynamics
    start: float
    end: float
    times: list[float] = field(default_factory=list)
    coordinates: list[Vector] = field(default_factory=list)
    largest: float = 0.0
    closed: ClosedForm | None = None
    falls: Vector | None = None
    final: Vector | None = None

    @property
    def mode(self) -> IndexSet:
        """The index set I of the mode, as it is reported."""
        return self.form.reported_mode(self.dynamics.mode)

    def marks(self) -> Vector:
        """Return the times between which one Taylor polynomial reaches, from start to end."""
        marks = np.array([*self.times, self.end])
        length = self.dynamics.step / self.form.units.rate
        pieces = np.maximum(np.ceil(np.diff(marks) / length - (LONGER - 1.0)), 1.0).astype(int)
        if pieces.max(initial=1) == 1:
            return marks
        parts = [
            np.linspace(a, b, n, endpoint=False) for a, b, n in zip(marks, marks[1:], pieces, strict=False)
        ]
        return np.concatenate([*parts, marks[-1:]])

    def at(self, t: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """Return x, u and y at times of this flow, shapes (m, n), (m, k), (m, k)."""
        return evaluate((self,), t)

    def coordinates_at(self, t: float) -> Vector:
        """Return the coordinates at a time of this flow, shape (d,)."""
        if t == self.end and self.final is not None:
            return self.final
        step = max(bisect_right(self.times, t) - 1, 0)
        elapsed = (t - self.times[step]) * self.form.units.rate
        start = self.coordinates[step][None]
        return np.asarray(_flowed(self.dynamics, self.closed, start, np.array([elapsed]))[0])


def evaluate(flows: Sequence[Flow], t: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at times in any order, right-continuous, shapes (m, n), (m, k), (m, k)."""
    return _in_steps(flows, _steps_at(flows, t), t)


def evaluate_states(flows: Sequence[Flow], t: Vector) -> Matrix:
    """Return x at times in any order, right-continuous, shape (m, n)."""
    x = np.empty((t.size, flows[0].form.reported(np.zeros((1, flows[0].form.system.shape[0]))).shape[1]))
    for rows, flow, c in _by_mode(flows, _steps_at(flows, t), t):
        x[rows] = flow.form.reported(c @ flow.dynamics.basis.T)
    return x


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


def flow_of_each(times: Sequence[Vector]) -> NDArray[np.intp]:
    """Return for each row of `evaluate_each` the number of its flow."""
    return np.repeat(np.arange(len(times)), [len(t) for t in times])


def flow_at(flows: Sequence[Flow], t: Vector) -> NDArray[np.intp]:
    """Return for each row of `evaluate` the number of its flow."""
    return np.maximum(np.searchsorted([flow.start for flow in flows], t, side="right") - 1, 0)


def _in_steps(flows: Sequence[Flow], steps: NDArray[np.intp], t: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at times of these steps, counted over all flows; where u is not unique, the least."""
    groups: dict[int, tuple[AutonomousForm, list[tuple[list[int], tuple[Matrix, Matrix, Matrix]]]]] = {}
    for rows, flow, c in _by_mode(flows, steps, t):
        values = _values(flow.form.system, flow.dynamics, c)
        groups.setdefault(id(flow.form), (flow.form, []))[1].append((rows, values))
    largest = max(flow.largest for flow in flows)
    if not groups:
        (n, k), form = flows[0].form.system.shape, flows[0].form
        return form.reported(np.zeros((0, n))), np.zeros((0, k)), np.zeros((0, k))
    found: list[Matrix] = []
    for form, parts in groups.values():
        rows = [row for group, _ in parts for row in group]
        z, u, y = (np.vstack(columns) for columns in zip(*(values for _, values in parts), strict=True))
        order = np.argsort(rows)
        place = np.array(rows)[order]
        reported = _reported(form, z[order], u[order], y[order], t[place], largest)
        if not found:
            found = [np.empty((t.size, columns.shape[1])) for columns in reported]
        for columns, part in zip(found, reported, strict=True):
            columns[place] = part
    x, u, y = found
    return x, u, y


def _reported(
    form: AutonomousForm, z: Matrix, u: Matrix, y: Matrix, t: Vector, largest: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y in the units given, or what is reported in their place."""
    pair = form.units.pair
    u, y = least_norm_multipliers(form.given, u * pair, y / pair)
    u, y = consistent_pairs(form.system, z, u / pair, y * pair, t, largest)
    u, y = u * pair, y / pair
    exchanged = np.isin(np.arange(u.shape[1]), form.exchanged)
    return form.reported(z), np.where(exchanged, y, u), np.where(exchanged, u, y)


def _by_mode(
    flows: Sequence[Flow], steps: NDArray[np.intp], t: Vector
) -> Iterator[tuple[list[int], Flow, Matrix]]:
    """Yield for each mode one of its flows, which of the times lie in it, and the coordinates there."""
    starts = [
        (flow, begin, c) for flow in flows for begin, c in zip(flow.times, flow.coordinates, strict=True)
    ]
    lasts = np.cumsum([len(flow.times) for flow in flows]) - 1
    ends = {id(flow): last for flow, last in zip(flows, lasts.tolist(), strict=True)}  # the last step of each
    rows_of: dict[tuple[int, int], list[int]] = {}
    for row, step in enumerate(steps.tolist()):
        flow = starts[step][0]
        rows_of.setdefault((id(flow.dynamics), id(flow.closed)), []).append(row)
    for rows in rows_of.values():
        held = []
        for step, time in zip(steps[rows].tolist(), t[rows].tolist(), strict=True):
            flow, begin, c = starts[step]
            at_end = time == flow.end and flow.final is not None and step == ends[id(flow)]
            held.append((time, flow.final) if at_end else (begin, c))
        flow = starts[steps[rows[0]]][0]
        elapsed = (t[rows] - np.array([begin for begin, _ in held])) * flow.form.units.rate
        yield rows, flow, _flowed(flow.dynamics, flow.closed, np.array([c for _, c in held]), elapsed)


def _flowed(dynamics: ModeDynamics, closed: ClosedForm | None, starts: Matrix, elapsed: Vector) -> Matrix:
    """Return the coordinates so long after these starts, in the form's units of time, shape (m, d)."""
    c, moved = starts.copy(), np.flatnonzero(elapsed)
    c[moved] = dynamics.flowed(starts[moved], np.minimum(elapsed[moved] / dynamics.step, LONGER))
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
