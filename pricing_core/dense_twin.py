"""The kernel's solvers of dense problems in plain Python and NumPy: what takes their place, and tests them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector

CLOSE = 0.01  # factors of a round that are all this near 1 end the rounds
ROUNDS = 12  # of equilibration; each halves the logarithm of what is left
LARGEST_EXPONENT = 400  # keeps the factors, and products of two of them, inside the range of a double
# Lemke's method; each is relative to the terms of a number, the first to the largest entry of the entering column.
SMALLEST_PIVOT = 1e-10
ROUNDING = 1e-13
LARGEST_DRIFT = 1e-9
NOISE = 3.6e-15
CHECKED_AFTER = 20  # pivots


def equilibrate(M: Matrix) -> tuple[Vector, Vector]:
    """Return the diagonals of R and C, powers of two, for which R M C has its largest entries near 1 (Ruiz 2001).

    A symmetric M stays symmetric. Cost: O(n**2).

    Examples
    --------
    >>> equilibrate(np.diag([4.0, 64.0]))
    (array([0.5  , 0.125]), array([0.5  , 0.125]))
    """
    row, column = np.ones(len(M)), np.ones(len(M))
    for _ in range(ROUNDS):
        magnitude = np.abs(row[:, None] * M * column)
        by_row = _inverse_root(np.max(magnitude, axis=1, initial=0.0))
        by_column = _inverse_root(np.max(magnitude, axis=0, initial=0.0))
        row, column = row * by_row, column * by_column
        if np.max(np.abs(np.append(by_row, by_column) - 1.0), initial=0.0) <= CLOSE:
            break
    return _power_of_two(row), _power_of_two(column)


def _inverse_root(largest: Vector) -> Vector:
    return np.asarray(1.0 / np.sqrt(np.where(largest > 0.0, largest, 1.0)))


def _power_of_two(x: Vector) -> Vector:
    exponent = np.clip(np.rint(np.log2(x)), -LARGEST_EXPONENT, LARGEST_EXPONENT)
    return np.asarray(np.exp2(exponent))


def lemke(
    M: Matrix, q: Vector, covering: Vector, max_pivots: int, interrupt: Callable[[], bool] | None = None
) -> tuple[str, Vector, BoolVector, int]:
    """Return (end, z, basic set, pivots) of Lemke's path of w - M z - d z0 = q, d the covering vector.

    `end` is "solved", "ray", "limit" after `max_pivots` or "interrupted"; z and the basic set are those of the last
    basis, z corrected by its residual, and zero where it is rounding alone.

    Examples
    --------
    >>> lemke(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-4.0, -5.0]), np.ones(2), 9)
    ('solved', array([1., 2.]), array([ True,  True]), 3)
    """
    n = q.size
    tableau = _Tableau(M, q, covering)
    end, pivots = ("solved", 0) if (q >= 0.0).all() else tableau.follow(max_pivots, interrupt)
    if end == "solved":
        tableau.correct()
    is_z = (tableau.basic >= n) & (tableau.basic < 2 * n)
    members = tableau.basic[is_z] - n
    z, basic_set = np.zeros(n), np.zeros(n, dtype=np.bool_)
    z[members], basic_set[members] = tableau.b[is_z], True
    return end, z, basic_set, pivots


class _Tableau:
    """x_basic[r] + sum_c a[r, c] x_nonbasic[c] = b[r], for the variables w: 0..n, z: n..2n, z0: 2n."""

    def __init__(self, M: Matrix, q: Vector, covering: Vector) -> None:
        self.M, self.q, self.covering = M, q, covering
        self.restart()

    def restart(self) -> None:
        """Make the first tableau: all w basic."""
        n = self.q.size
        self.a = np.column_stack([-self.M, -self.covering])
        self.b = self.q.copy()
        self.basic, self.nonbasic = np.arange(n), np.arange(n, 2 * n + 1)

    def follow(self, max_pivots: int, interrupt: Callable[[], bool] | None) -> tuple[str, int]:
        n = self.q.size
        # The lexicographic minimum of (q_i, e_i) / d_i: among equal q_i / d_i the last row.
        row: int | None = n - 1 - int(np.argmin((self.q / self.covering)[::-1]))
        entering = 2 * n
        for pivot in range(1, max_pivots + 1):
            assert row is not None
            leaving = int(self.basic[row])
            self.exchange(row, self.column_of(entering))
            if leaving == 2 * n:
                return "solved", pivot
            if interrupt is not None and interrupt():
                return "interrupted", pivot
            if pivot % CHECKED_AFTER == 0 and self.refine() > LARGEST_DRIFT:
                self.refactor()
            entering = leaving + n if leaving < n else leaving - n
            row = self.leaving_row(self.column_of(entering))
            if row is None:
                return "ray", pivot
        return "limit", max_pivots

    def column_of(self, variable: int) -> int:
        return int(np.flatnonzero(self.nonbasic == variable)[0])

    def exchange(self, r: int, c: int) -> None:
        reciprocal = 1.0 / self.a[r, c]
        pivot_row, value = self.a[r] * reciprocal, self.b[r] * reciprocal
        factors = self.a[:, c].copy()
        factors[r] = 0.0
        self.a -= np.outer(factors, pivot_row)
        self.b -= factors * value
        self.a[:, c] = -factors * reciprocal
        pivot_row[c] = reciprocal
        self.a[r], self.b[r] = pivot_row, value
        self.basic[r], self.nonbasic[c] = self.nonbasic[c], self.basic[r]

    def inverse(self, rows: NDArray[np.intp]) -> Matrix:
        """Return rows of the inverse basis, whose columns stand in those of the slacks."""
        n = self.q.size
        inverse = np.zeros((rows.size, n))
        slack = self.nonbasic < n
        inverse[:, self.nonbasic[slack]] = self.a[np.ix_(rows, slack)]
        own = np.flatnonzero(self.basic[rows] < n)
        inverse[own, self.basic[rows[own]]] = 1.0
        return inverse

    def leaving_row(self, c: int) -> int | None:
        """Return the row of the lexicographically smallest ratio, z0's if it ties; None where there is none."""
        column = self.a[:, c]
        rows = np.flatnonzero(column > max(SMALLEST_PIVOT * float(np.max(np.abs(column))), 1e-300))
        if rows.size == 0:
            return None
        values, slopes = np.maximum(self.b[rows], 0.0), column[rows]
        inverse = self.inverse(rows)
        noise = ROUNDING * (np.abs(inverse) @ np.abs(self.q))
        tied = values / slopes <= np.min((values + noise) / slopes)
        rows, ratios = rows[tied], inverse[tied] / slopes[tied, None]
        artificial = rows[self.basic[rows] == 2 * self.q.size]
        if artificial.size:
            return int(artificial[0])
        noise = ROUNDING * np.max(np.abs(ratios), axis=1)
        for k in range(self.q.size):
            if rows.size == 1:
                break
            least = ratios[:, k] <= np.min(ratios[:, k] + noise)
            rows, ratios, noise = rows[least], ratios[least], noise[least]
        return int(rows[0])

    def residual(self) -> tuple[Vector, Vector]:
        """Return q - w + M z + d z0 for the basic values, and the sizes of the terms of each row."""
        n = self.q.size
        values = np.zeros(2 * n + 1)
        values[self.basic] = self.b
        w, z, z0 = values[:n], values[n:-1], values[-1]
        sizes = np.abs(self.M) @ np.abs(z) + np.abs(self.q) + np.abs(self.covering * z0)
        return self.q - w + self.M @ z + self.covering * z0, sizes

    def refine(self) -> float:
        """Correct the basic values by their residual; return the largest correction relative to its terms."""
        residual, sizes = self.residual()
        inverse = self.inverse(np.arange(self.q.size))
        correction, terms = inverse @ residual, np.abs(inverse) @ sizes
        self.b = self.b + correction
        drift = np.abs(correction) / np.where(terms > 0.0, terms, np.inf)
        return float(np.max(drift, initial=0.0)) if np.isfinite(correction).all() else np.inf

    def refactor(self) -> None:
        """Make the tableau of this basis afresh from the data, with the largest pivots; leave it where one is zero."""
        kept = self.a, self.b, self.basic, self.nonbasic
        wanted = self.basic.copy()
        self.restart()
        for variable in np.sort(wanted[wanted >= self.q.size]).tolist():
            c = self.column_of(variable)
            sizes = np.where(np.isin(self.basic, wanted), -1.0, np.abs(self.a[:, c]))
            r = int(np.argmax(sizes))
            if not sizes[r] > 1e-300:
                self.a, self.b, self.basic, self.nonbasic = kept
                return
            self.exchange(r, c)
        self.refine()

    def correct(self) -> None:
        """Bring the last values to rounding level, and set to zero what is rounding alone."""
        if self.refine() > LARGEST_DRIFT:
            self.refactor()
        self.refine()
        n = self.q.size
        sizes = np.abs(self.inverse(np.arange(n))) @ self.residual()[1]
        kept = self.b
        self.b = np.where((self.basic >= n) & (np.abs(kept) <= NOISE * sizes), 0.0, kept)
        residual, sizes = self.residual()
        is_slack = np.isin(np.arange(n), self.basic)
        if not (is_slack | (np.abs(residual) <= NOISE * sizes)).all():
            self.b = kept
