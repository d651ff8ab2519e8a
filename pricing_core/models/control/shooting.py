"""Multiple shooting on the complementarity system (11.25) with the junction times as unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.control.layout import Layout
from pricing_core.models.control.problem import LQData

MOST_STEPS = 40
CLOSE = 1e-11  # residual against the size of the solution
NEAR = 1e-6  # residual from which on a step is as good as the last one
SHRINK = 0.2  # a step leaves every segment at least this share of its length
# Share of the horizon by which junctions may pass each other in a step, simultaneous ones above all.
OVERLAP = 0.02
# Share of the horizon below which junctions that passed each other are simultaneous.
TOGETHER = 1e-9
RANK = 1e-15


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A solution of the equations of one structure; whether the signs are right is another question.

    Parameters
    ----------
    times : Vector, shape (segments + 1,)
    starts : tuple of Matrix, shape (pieces, d + 1)
        (c, 1) at the start of every piece of every segment.
    atoms : tuple of Vector
        The atoms of each junction, for the constraints in its `with_atom`.
    residual : float
        The largest violation of the equations, against the size of (x, lambda).
    converged : bool
        The equations hold. Junctions may nevertheless have passed each other.
    """

    times: Vector
    starts: tuple[Matrix, ...]
    atoms: tuple[Vector, ...]
    residual: float
    converged: bool

    @property
    def is_ordered(self) -> bool:
        """The junctions stand in the order in which they were laid out."""
        return bool(np.all(np.diff(self.times) >= 0.0))


def shoot(data: LQData, plan: Layout) -> Shot:
    """Solve for the pieces' starts, the junction times and the atoms by the Gauss-Newton method.

    The equations: x(0) = x0; every piece starts where the one before ends; at a junction x is continuous and
    lambda(t+) = lambda(t-) - C^T eta({t}); at a touch point y = y' = 0; lambda(T-) = C^T eta({T}). They are linear
    but for the times. Where a structure gives more equations than unknowns that are nevertheless consistent (an arc
    at rest) the method converges as well, which is why it solves least-squares problems.
    """
    problem = _Equations(data, plan)
    times = plan.times.copy()
    v = np.zeros(problem.size)
    residual, J = problem.linearised(v, times)
    v -= _step(J[:, : problem.size], residual)  # linear, as long as the times stay
    share, error = 1.0, np.inf
    for _ in range(MOST_STEPS):
        residual, J = problem.linearised(v, times)
        scale = 1.0 + float(np.max(np.abs(v), initial=0.0))
        last, error = error, float(np.max(np.abs(residual))) / scale
        if not np.isfinite(error) or not np.all(np.isfinite(J)):  # the flow left the range of numbers
            error = np.inf
            break
        if share == 1.0 and error <= CLOSE and error >= 0.1 * last:
            break
        step = _step(J, residual)
        change = np.concatenate([[0.0], -step[problem.size :], [0.0]])
        share = _share(np.diff(times), np.diff(change), data.horizon)
        v, times = v - share * step[: problem.size], times + share * change
        if share == 1.0 and error <= NEAR:  # what rounding left of the equations that are linear
            residual, J = problem.linearised(v, times)
            v = v - _step(J[:, : problem.size], residual)
    starts, atoms = problem.unpack(v)
    if np.all(np.diff(times) >= -TOGETHER * data.horizon):
        times = np.maximum.accumulate(times)
    return Shot(times, starts, atoms, error, bool(error <= CLOSE and share == 1.0))


def _step(J: Matrix, residual: Vector) -> Vector:
    sizes = np.linalg.norm(J, axis=0)
    sizes[sizes == 0.0] = 1.0
    scaled = lstsq(J / sizes, residual, cond=RANK, lapack_driver="gelsy", check_finite=False)[0]
    return np.asarray(scaled / sizes)


def _share(lengths: Vector, changes: Vector, horizon: float) -> float:
    """Return the share of a step that keeps the junctions in order, or nearly so, and inside the horizon."""
    shrinking = changes < 0.0
    overlapping = np.maximum(lengths + OVERLAP * horizon, 0.0)
    overlapping[0] = 0.0
    room = np.maximum((1.0 - SHRINK) * lengths, overlapping)
    return float(np.min(room[shrinking] / np.maximum(-changes[shrinking], room[shrinking]), initial=1.0))


class _Equations:
    """The residual and its derivative, with the unknowns: all c, then all atoms, then the times."""

    def __init__(self, data: LQData, plan: Layout) -> None:
        self.data, self.plan = data, plan
        sizes = [flow.size for flow, m in zip(plan.arcs, plan.pieces, strict=True) for _ in range(m)]
        sizes += [len(junction.with_atom) for junction in plan.junctions]
        self.offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        self.size = int(self.offsets[-1])
        self.first = np.concatenate([[0], np.cumsum(plan.pieces)]).astype(int)

    def unpack(self, v: Vector) -> tuple[tuple[Matrix, ...], tuple[Vector, ...]]:
        blocks = [v[a:b] for a, b in zip(self.offsets, self.offsets[1:], strict=False)]
        starts = tuple(
            np.array([np.append(c, 1.0) for c in blocks[self.first[s] : self.first[s + 1]]])
            for s in range(len(self.plan.arcs))
        )
        return starts, tuple(blocks[int(self.first[-1]) :])

    def linearised(self, v: Vector, times: Vector) -> tuple[Vector, Matrix]:
        """Return the residual and its Jacobian, of shape (equations, size + junction times)."""
        data, plan = self.data, self.plan
        n, (starts, atoms) = data.states, self.unpack(v)
        residuals: list[Vector] = [plan.arcs[0].state(starts[0][0])[:n] - data.x0]
        rows: list[Matrix] = [self._row(n)]
        rows[0][:, self._piece(0, 0)] = plan.arcs[0].basis[:n]
        for s, (flow, pieces) in enumerate(zip(plan.arcs, plan.pieces, strict=True)):
            E = flow.transition(float(times[s + 1] - times[s]) / pieces)[:-1]
            ends = starts[s] @ E.T
            speeds = np.column_stack([ends, np.ones(pieces)]) @ flow.rate.T / pieces
            for j in range(pieces - 1):
                row = self._row(flow.size)
                row[:, self._piece(s, j + 1)] = np.eye(flow.size)
                self._end(row, s, j, -np.eye(flow.size), E, speeds[j])
                rows.append(row)
                residuals.append(starts[s][j + 1, :-1] - ends[j])
            last = (E, ends[-1], speeds[-1])
            self._junction(s, last, starts, atoms[s], residuals, rows)
        return np.concatenate(residuals), np.vstack(rows)

    def _junction(
        self,
        s: int,
        last: tuple[Matrix, Vector, Vector],
        starts: tuple[Matrix, ...],
        atoms: Vector,
        residuals: list[Vector],
        rows: list[Matrix],
    ) -> None:
        data, plan, n = self.data, self.plan, self.data.states
        (E, end, speed), flow, junction = last, plan.arcs[s], plan.junctions[s]
        z = flow.state(np.append(end, 1.0))
        is_last = s + 1 == len(plan.arcs)
        kept = slice(n, 2 * n) if is_last else slice(0, 2 * n)  # at the horizon lambda(T+) = 0
        row = self._row(2 * n)
        jump = np.vstack([np.zeros((n, len(junction.with_atom))), data.C[list(junction.with_atom)].T])
        row[:, self._atoms(s)] = jump
        self._end(row, s, plan.pieces[s] - 1, -flow.basis, E, speed)
        residual = jump @ atoms - z
        if not is_last:
            after = plan.arcs[s + 1]
            row[:, self._piece(s + 1, 0)] = after.basis
            residual = residual + after.state(starts[s + 1][0])
        rows.append(row[kept])
        residuals.append(residual[kept])
        for i in junction.touching:
            measures = data.C[i][None] if is_last else np.vstack([data.C[i], data.C[i] @ data.A])
            row = self._row(measures.shape[0])
            self._end(row, s, plan.pieces[s] - 1, measures @ flow.basis[:n], E, speed)
            rows.append(row)
            residuals.append(measures @ z[:n] - np.array([data.bound[i], 0.0])[: measures.shape[0]])

    def _end(self, row: Matrix, s: int, j: int, weight: Matrix, E: Matrix, speed: Vector) -> None:
        """Add weight times the derivative of a piece's end by its start and by the segment's two times."""
        row[:, self._piece(s, j)] += weight @ E[:, :-1]
        for junction, sign in ((s - 1, -1.0), (s, 1.0)):
            if 0 <= junction < len(self.plan.arcs) - 1:
                row[:, self.size + junction] += sign * (weight @ speed)

    def _row(self, equations: int) -> Matrix:
        return np.zeros((equations, self.size + len(self.plan.arcs) - 1))

    def _piece(self, s: int, j: int) -> slice:
        index = int(self.first[s]) + j
        return slice(int(self.offsets[index]), int(self.offsets[index + 1]))

    def _atoms(self, s: int) -> slice:
        index = int(self.first[-1]) + s
        return slice(int(self.offsets[index]), int(self.offsets[index + 1]))
