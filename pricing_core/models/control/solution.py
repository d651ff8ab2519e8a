"""The answer to an optimal control problem with state constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.models.control.collocation import Collocation
from pricing_core.models.control.problem import LQData
from pricing_core.models.control.resolve import Resolved
from pricing_core.models.control.sampling import cost

Status = Literal["solved", "structure not resolved"]
Atoms = tuple[tuple[float, Vector], ...]
NOTHING = 1e-10  # Share of the largest atom or costate below which an atom is none.


@dataclass(frozen=True, slots=True, eq=False)
class OptimalControl:
    """The state x, the control u and the multipliers of the maximum principle, in the signs of (11.24): u = B^T lambda.

    lambda' = Q x - A^T lambda - C^T eta between the atoms, lambda(t+) = lambda(t-) - C^T eta({t}) at an atom, and
    lambda(T-) = C^T eta({T}), so that lambda(T) = 0 (11.24b) holds behind the last atom.

    Parameters
    ----------
    t : Vector, shape (r,)
        Junctions stand twice, before and after.
    x, costate : Matrix, shape (r, n)
    control : Matrix, shape (r, m)
    multiplier : Matrix, shape (r, k)
        The density of eta.
    multiplier_atoms : tuple of (float, Vector of shape (k,))
        The atoms of eta: at junctions and touch points of constraints of order >= 2, and at the horizon.
    cost : float
        (11.21), with its factor 1/2.
    switching_times : Vector, shape (s,)
        Junctions and touch points inside (0, T).
    arcs : tuple of tuple of int
        The constraints that are active before, between and after those times, s + 1 sets; none where the structure is
        not resolved.
    status : {"solved", "structure not resolved"}
        In the second case the values are those of collocation, accurate to its step; the multiplier is what each
        interval holds of eta, divided by its length.
    residual : float
        The largest violation of the equations of the shooting, relative; nan where there was none.
    """

    t: Vector
    x: Matrix
    costate: Matrix
    multiplier: Matrix
    multiplier_atoms: Atoms
    control: Matrix
    cost: float
    switching_times: Vector
    arcs: tuple[IndexSet, ...]
    status: Status
    residual: float


def solved(data: LQData, answer: Resolved) -> OptimalControl:
    """Return the answer of the shooting."""
    shot, plan, samples = answer.shot, answer.plan, answer.samples
    costate = np.vstack([part.costate for part in samples])
    size = max(1.0, float(np.max(np.abs(costate))))
    lengths = np.diff(shot.times)
    return OptimalControl(
        t=np.concatenate([part.t for part in samples]),
        x=np.vstack([part.x for part in samples]),
        costate=costate,
        multiplier=np.vstack([part.multiplier for part in samples]),
        multiplier_atoms=_atoms(data, answer, NOTHING * size),
        control=costate @ data.B,
        cost=cost(data, plan, shot),
        switching_times=np.unique(shot.times)[1:-1],
        arcs=tuple(arc.mode for arc, length in zip(plan.arcs, lengths, strict=True) if length > 0.0),
        status="solved",
        residual=shot.residual,
    )


def _atoms(data: LQData, answer: Resolved, nothing: float) -> Atoms:
    """Return the atoms in the order of time; simultaneous junctions have one together."""
    found: dict[float, Vector] = {}
    shot, plan = answer.shot, answer.plan
    for junction, time, weights in zip(plan.junctions, shot.times[1:], shot.atoms, strict=True):
        full = found.setdefault(float(time), np.zeros(data.C.shape[0]))
        full[list(junction.with_atom)] += weights
    return tuple((time, full) for time, full in found.items() if np.any(full > nothing))


def unresolved(data: LQData, answer: Collocation) -> OptimalControl:
    """Return the answer of collocation: node values of lambda and u are means of the midpoints beside them."""
    h = float(answer.t[1])
    half = 0.5 * h * (0.5 * (answer.x[1:] + answer.x[:-1]) @ data.Q - answer.costate @ data.A)
    inner = 0.5 * (answer.costate[1:] + answer.costate[:-1])
    costate = np.vstack([answer.costate[:1] - half[:1], inner, answer.costate[-1:] + half[-1:]])
    multiplier = answer.masses / h
    multiplier[-1] = 0.0
    last = answer.masses[-1]
    is_atom = bool(np.any(last > h * np.max(answer.masses[:-1] / h, axis=0, initial=0.0) + NOTHING))
    return OptimalControl(
        t=answer.t,
        x=answer.x,
        costate=costate,
        multiplier=multiplier,
        multiplier_atoms=((data.horizon, last.copy()),) if is_atom else (),
        control=costate @ data.B,
        cost=answer.cost,
        switching_times=np.zeros(0),
        arcs=(),
        status="structure not resolved",
        residual=float("nan"),
    )
