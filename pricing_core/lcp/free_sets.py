"""The iteration of `solve_multigrid` on one matrix: sweeps, then a linear step on the unknowns that are free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from pricing_core import kernel
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import IterationLimitError
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.coefficients import absolute
from pricing_core.linalg.multigrid import Multigrid, near_null_vectors, solve_preconditioned

EPSILON = float(np.finfo(np.float64).eps)
SWEEPS = 4  # before each linear system
FIRST_SWEEPS = 6  # the rate of the second half shows whether sweeps alone are enough
FAST = 0.5  # factor by which each sweep must lower the residual for that
MOST_ITERATIONS = 200
PROGRESS = 0.9  # factor of the least residual that counts as one
NOTHING = 1e-12  # share by which z'Mz/2 + q'z must fall for that, where M is symmetric
PATIENCE = 6  # iterations without one after which sweeps alone go on from the best point
RESTING_SWEEPS, MOST_RESTS = 50, 5
STALE = 0.02  # share of the unknowns that may change sides before the multigrid hierarchy is made afresh
LOOSE, TIGHT = 0.05, 1e-4  # of linear systems: where the free set has changed, and where it is settled
LINEAR_STEPS, MOST_LINEAR_STEPS = 30, 480  # the first where a few are enough
HALVINGS = 5
DIVERGED = 1e10  # factor of the least residual from which on nothing is hoped for
FALLING = "the residual of multigrid stopped falling, and nothing is proved"

Report = Callable[[int, float, Vector], bool]  # of (iteration, residual, z): whether it is done


class FreeSets:
    """M, q and bounds of a problem; the diagonal of M is positive."""

    def __init__(self, M: csr_array, q: Vector, lower: Vector, upper: Vector, symmetric: bool) -> None:
        self.M, self.q, self.lower, self.upper, self.symmetric = M, q, lower, upper, symmetric
        self.near_null = near_null_vectors(M) if symmetric else None
        self._magnitude = absolute(M)
        self._indptr, self._indices = M.indptr.astype(np.int64), M.indices.astype(np.int64)

    def swept(self, z: Vector, sweeps: int, clock: TimeLimit) -> Vector:
        """Return z after projected Gauss-Seidel sweeps, forward and backward in turn."""
        parts = self._indptr, self._indices, self.M.data, self.q, self.lower, self.upper
        found, _ = kernel.sparse_sweeps(*parts, z, 1.0, -1.0, sweeps, True, clock)
        clock.check("multigrid")
        return np.asarray(found)

    def residual(self, z: Vector, slack: Vector) -> float:
        """Return max |z - mid(lower, z - w, upper)|."""
        middle = np.minimum(np.maximum(slack, z - self.upper), z - self.lower)
        return float(np.abs(middle).max(initial=0.0))

    def rounding(self, z: Vector) -> float:
        """Return a bound of the rounding error of w."""
        return 4.0 * EPSILON * float((self._magnitude @ np.abs(z) + np.abs(self.q)).max(initial=0.0))

    def swept_out(
        self, z: Vector, is_solved: Callable[[float, Vector], bool], limit: int, clock: TimeLimit
    ) -> tuple[Vector, int, bool]:
        """Return z after sweeps, their number, and whether they solved the problem, as fast ones do."""
        residuals: list[float] = []
        for sweeps in range(FIRST_SWEEPS // 2, limit, FIRST_SWEEPS // 2):
            z = self.swept(z, FIRST_SWEEPS // 2, clock)
            residuals.append(self.residual(z, self.M @ z + self.q))
            if is_solved(residuals[-1], z):
                return z, sweeps, True
            if len(residuals) > 1 and not residuals[-1] < FAST ** (FIRST_SWEEPS // 2) * residuals[-2]:
                break
        return z, sweeps, False

    def improved(
        self, z: Vector, report: Report, clock: TimeLimit, limit: int | None = None
    ) -> tuple[Vector, int]:
        """Return a z for which `report` is true, or the z after the largest number of iterations, and their number.

        Raises
        ------
        IterationLimitError
            The residual stopped falling.
        """
        best, best_z, least, waited, rests = np.inf, z, np.inf, 0, 0
        step = _LinearStep(self)
        for iteration in range(MOST_ITERATIONS if limit is None else limit):
            z = self.swept(z, SWEEPS, clock)
            slack = self.M @ z + self.q
            residual = self.residual(z, slack)
            if not residual <= DIVERGED * min(best, 1e290):
                break
            if report(iteration, residual, z):
                return z, iteration
            measure = 0.5 * float(z @ (slack + self.q)) if self.symmetric else residual
            falls = measure < least - abs(least) * NOTHING if self.symmetric else residual < PROGRESS * least
            waited = 0 if falls or not np.isfinite(least) else waited + 1
            least = min(least, measure)
            if residual < best:
                best, best_z = residual, z
            if waited >= PATIENCE:
                if rests == MOST_RESTS:
                    break
                z, waited, rests = self.swept(best_z, RESTING_SWEEPS, clock), 0, rests + 1
                continue
            z = self._moved(z, slack, step(z, slack))
        if limit is not None:
            return best_z, limit
        raise IterationLimitError(f"{FALLING}: M may be neither positive definite nor an M-matrix")

    def _moved(self, z: Vector, slack: Vector, step: Vector) -> Vector:
        """Return z + step between the bounds; for a symmetric M so much of the step that z'Mz/2 + q'z does not rise."""
        for halvings in range(HALVINGS + 1):
            aimed = z + 0.5**halvings * step
            moved = np.clip(aimed, self.lower, self.upper)
            if not self.symmetric or (halvings == 0 and np.array_equal(aimed, moved)):
                return moved
            change = moved - z
            if slack @ change + 0.5 * (change @ (self.M @ change)) <= 0.0:
                return moved
        return z


class _LinearStep:
    """Solves M_FF d = -w_F for the set F of free unknowns, with a hierarchy of an F that was nearly the same."""

    def __init__(self, level: FreeSets) -> None:
        self.level = level
        self.hierarchy: Multigrid | None = None
        self.known: BoolVector = np.zeros(0, dtype=np.bool_)  # the set that the hierarchy was made for
        self.places: NDArray[np.integer] = np.zeros(0, dtype=np.int64)
        self.free: BoolVector | None = None  # of the last call
        self.reliable, self.steps = True, LINEAR_STEPS

    def __call__(self, z: Vector, slack: Vector) -> Vector:
        level = self.level
        free = ((z > level.lower) | (slack < 0.0)) & ((z < level.upper) | (slack > 0.0))
        if not free.any():
            return np.zeros_like(z)
        settled = self.free is not None and np.array_equal(free, self.free)
        self.free = free
        changed = np.count_nonzero(free != self.known) if self.hierarchy is not None else z.size
        if self.hierarchy is None or changed > STALE * z.size or (changed and not self.reliable):
            self._prepare(free)
        elif not self.reliable:
            self.steps = min(2 * self.steps, MOST_LINEAR_STEPS)
        masked = LinearOperator(level.M.shape, matvec=self._product, dtype=np.float64)
        inverse = LinearOperator(level.M.shape, matvec=self._approximate, dtype=np.float64)
        step, self.reliable = solve_preconditioned(
            masked,
            np.where(free, -slack, 0.0),
            inverse,
            symmetric=level.symmetric,
            tolerance=TIGHT if settled else LOOSE,
            limit=self.steps,
        )
        return step if np.isfinite(step).all() else np.zeros_like(z)

    def _prepare(self, free: BoolVector) -> None:
        self.known, self.places, self.reliable = free, np.flatnonzero(free), True
        self.hierarchy = None  # frees its memory before the next one is made
        principal = self.level.M[self.places][:, self.places]
        near_null = self.level.near_null
        self.hierarchy = Multigrid.of(principal, None if near_null is None else near_null[self.places])

    def _product(self, x: Vector) -> Vector:
        assert self.free is not None
        return np.where(self.free, self.level.M @ np.where(self.free, x, 0.0), 0.0)

    def _approximate(self, r: Vector) -> Vector:
        """Apply one cycle to the unknowns that the hierarchy knows, and the inverse diagonal to the others."""
        assert self.hierarchy is not None
        assert self.free is not None
        x = r / self.level.M.diagonal()
        x[self.places] = self.hierarchy.inverse @ r[self.places]
        return np.where(self.free, x, 0.0)
