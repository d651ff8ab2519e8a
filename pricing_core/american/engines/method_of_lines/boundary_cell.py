"""The exercise boundary inside a cell: what makes the error of a stage regular wherever the boundary lies.

Next to the boundary x_f the slack is the parabola J (x - x_f)**2/2 on the free side, and a J = u with the diffusion
coefficient a and the multiplier u just inside the exercise region. The stencil of the last free node x_m reads z = 0 at
the first contact node, a distance d away, where the continuation of the parabola is J d**2 (1 - theta)**2/2, theta =
(x_f - x_m)/d: its row lacks h l times that, l the stencil's entry. Adding it, z_m = z0_m + J d**2/2 b (1 - theta)**2
with b = h l (M^-1)_mm must be J d**2/2 theta**2: a quadratic equation for theta. Without it the error of the stage
depends on theta, and does not fall regularly where the boundary stands still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.engines.method_of_lines.operators import ThreePointOperator
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import (
    OptionState,
    StageProblem,
    TridiagonalStage,
)
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.linalg import solve_tridiagonal

PASSES = 4  # Largest number of passes in which the contact set must settle; measured: one or two are enough.


@dataclass(frozen=True, slots=True)
class Edge:
    """An end of a run of contact nodes: the last free node, and the contact node next to it."""

    free: int
    contact: int


@dataclass(frozen=True, slots=True)
class BoundaryCellStage:
    """A stage of `TridiagonalStage`, corrected for the place of the exercise boundary in its cell."""

    inner: TridiagonalStage

    @property
    def form(self) -> SegmentForm:
        """The system it belongs to."""
        return self.inner.form

    def solve(self, t: float, base: Vector, h: float, near: OptionState) -> OptionState:
        """Return the state t years before the segment's end."""
        state = self.inner.solve(t, base, h, near)
        if not state.contact.any():
            return state
        form = self.form.at(t)
        problem = StageProblem.of(form, t, base, h)
        M, q = problem.M, problem.q
        contact = state.contact.copy()
        for _ in range(PASSES):
            edges = _edges(form, contact)
            columns = _free_solutions(M, q, contact, edges)
            z, lifted, changed = columns[:, 0], q, False
            for edge, response in zip(edges, columns[:, 1:].T, strict=True):
                theta, missing = _place(form, edge, z, h, response)
                if theta > 1.0:
                    contact[edge.contact], changed = False, True
                elif theta < 0.0:
                    contact[edge.free], changed = True, True
                else:
                    z = z + missing * response
                    lifted = lifted.copy()
                    lifted[edge.free] -= missing
            if not changed:
                break
        else:
            return state
        z = np.maximum(z, 0.0)
        w = M.times(z) + lifted
        residual, rounding = problem.measured(z, w, self.form.scale)
        if residual > state.residual + rounding:
            return state
        return replace(
            state,
            value=problem.obstacle + z,
            slack=z,
            contact=contact,
            multiplier=np.maximum(w, 0.0) / h,
            residual=residual,
            continued=(q - lifted) / h,
        )


def _edges(form: SegmentForm, contact: BoolVector) -> list[Edge]:
    """Return the ends of the exercise region at which holding costs something."""
    right = [Edge(int(k) + 1, int(k)) for k in np.flatnonzero(contact[:-1] & ~contact[1:])]
    left = [Edge(int(k), int(k) + 1) for k in np.flatnonzero(contact[1:] & ~contact[:-1])]
    both = {edge.free for edge in right} & {edge.free for edge in left}
    return [edge for edge in (*right, *left) if edge.free not in both and form.curvature(edge.contact) > 0.0]


def _place(form: SegmentForm, edge: Edge, z: Vector, h: float, response: Vector) -> tuple[float, float]:
    """Return theta, and what the free node's row lacks."""
    operator, nodes = form.operator, form.grid.interior
    entry = operator.lower[edge.free] if edge.contact < edge.free else operator.upper[edge.free]
    full = 0.5 * form.curvature(edge.contact) * (nodes[edge.contact] - nodes[edge.free]) ** 2
    b = h * entry * response[edge.free]
    relative = z[edge.free] / full
    # (1 - b) theta**2 + 2 b theta - (b + relative) = 0
    discriminant = b**2 + (1.0 - b) * (b + relative)
    if relative < -b or discriminant < 0.0:
        return -1.0, 0.0
    theta = (b + relative) / (b + math.sqrt(discriminant))
    return theta, h * entry * full * (1.0 - theta) ** 2


def region_in_cells(state: OptionState, form: SegmentForm) -> ExerciseRegion:
    """Return the exercise region of a state in s = S/K, its ends placed inside their cells."""
    contact = np.flatnonzero(state.contact)
    if not form.segment.exercisable or contact.size == 0:
        return EMPTY_REGION
    first, last = int(contact[0]), int(contact[-1])
    lower = -math.inf if first == 0 else _boundary(state, form, first, -1)
    upper = math.inf if last == state.contact.size - 1 else _boundary(state, form, last, 1)
    return ExerciseRegion(lower, upper)


def _boundary(state: OptionState, form: SegmentForm, contact: int, direction: int) -> float:
    """Return the boundary next to a contact node, the free side of it in `direction`.

    A distance x inside the free side sqrt(2 (v - g)/J) is x + k x**2; two free nodes give k and the boundary.
    """
    nodes, curvature = form.grid.interior, form.curvature(contact)
    near, far = contact + direction, contact + 2 * direction
    if curvature <= 0.0 or not 0 <= far < nodes.size:
        return float(nodes[contact])
    roots = np.sqrt(2.0 * np.maximum(state.slack[[near, far]], 0.0) / curvature)
    first, second, d = float(roots[0]), float(roots[1]), abs(float(nodes[far] - nodes[near]))
    # k = (first - x)/x**2 = (second - x - d)/(x + d)**2
    a, b = second + d - first, d * (2.0 * first - d)
    if a <= 0.0:
        return float(nodes[contact])
    x = (b + math.sqrt(max(b**2 + 4.0 * a * first * d**2, 0.0))) / (2.0 * a)
    width = abs(float(nodes[near] - nodes[contact]))
    return float(nodes[near]) - direction * min(x, width)


def _free_solutions(M: ThreePointOperator, q: Vector, contact: BoolVector, edges: list[Edge]) -> Matrix:
    """Return the solution of Mz + q = 0 with z = 0 in contact, and its response to a unit in each edge's row."""
    rhs = np.zeros((q.size, 1 + len(edges)))
    rhs[:, 0] = np.where(contact, 0.0, -q)
    for column, edge in enumerate(edges):
        rhs[edge.free, 1 + column] = 1.0
    diagonal = np.where(contact, 1.0, M.diagonal)
    upper = np.where(contact, 0.0, M.upper)[:-1]
    lower = np.where(contact, 0.0, M.lower)[1:]
    return solve_tridiagonal(lower, diagonal, upper, rhs)
