"""The flow in one mode between two events, as a chain of Taylor polynomials."""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.closed_form import ClosedForm
from pricing_core.lcs.mode_dynamics import POWERS, ModeDynamics

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
    closed : ClosedForm, optional
        Of the last step, where that is longer than one Taylor polynomial reaches.
    """

    form: AutonomousForm
    dynamics: ModeDynamics
    start: float
    end: float
    times: list[float] = field(default_factory=list)
    coordinates: list[Vector] = field(default_factory=list)
    closed: ClosedForm | None = None

    @property
    def mode(self) -> IndexSet:
        """I."""
        return self.dynamics.mode

    def at(self, t: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """Return x, u and y at increasing times of this flow, shapes (m, n), (m, k), (m, k)."""
        form, dynamics = self.form, self.dynamics
        c = self.coordinates_at(t)
        z, (C, D) = c @ dynamics.basis.T, (form.system.C, form.system.D)
        u = np.where(dynamics.active, c @ dynamics.outputs.T, 0.0)
        u = _without_negative_rounding(u, c, dynamics.outputs)
        y = np.where(dynamics.active, 0.0, z @ C.T + u @ D.T)
        y = _without_negative_rounding(y, np.hstack([z, u]), np.hstack([C, D]))
        return (z * form.units.state)[:, : form.states], u * form.units.pair, y / form.units.pair

    def coordinates_at(self, t: Vector) -> Matrix:
        """Return the coordinates at increasing times of this flow, shape (m, d)."""
        rate, dynamics = self.form.units.rate, self.dynamics
        steps = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1)
        c = np.empty((t.size, dynamics.rate.shape[0]))
        for step in np.unique(steps):
            rows, start = np.flatnonzero(steps == step), self.coordinates[step]
            elapsed = (t[rows] - self.times[step]) * rate
            near = elapsed <= LONGER * dynamics.step
            powers = (elapsed[near] / dynamics.step)[:, None] ** POWERS
            c[rows[near]] = powers @ dynamics.expansion(start)
            far = rows[~near]
            if far.size and self.closed is not None:
                c[far] = self.closed.states(start, elapsed[~near])
            elif far.size:
                c[far] = [expm(dynamics.rate * length) @ start for length in elapsed[~near]]
        return c


def _without_negative_rounding(values: Matrix, terms: Matrix, gains: Matrix) -> Matrix:
    """Return values = terms @ gains.T, those zero that are negative by rounding."""
    sizes, largest = np.abs(terms), np.abs(terms).max(axis=1, initial=0.0)[:, None]
    rounding = (NEGATIVE * sizes + LEFT * largest) @ np.abs(gains).T
    return np.where((values < 0.0) & (values >= -rounding), 0.0, values)


def evaluate(flows: tuple[Flow, ...], t: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return x, u and y at times in any order, right-continuous, shapes (m, n), (m, k), (m, k)."""
    which = np.clip(np.searchsorted([flow.start for flow in flows], t, side="right") - 1, 0, len(flows) - 1)
    n, k = flows[0].form.states, flows[0].dynamics.outputs.shape[0]
    x, u, y = np.empty((t.size, n)), np.empty((t.size, k)), np.empty((t.size, k))
    for index in np.unique(which):
        rows = which == index
        x[rows], u[rows], y[rows] = flows[index].at(t[rows])
    return x, u, y
