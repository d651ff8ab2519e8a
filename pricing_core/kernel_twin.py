"""The kernel's solvers of tridiagonal problems in plain Python and NumPy: what takes their place, and tests them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector

Interrupt = Callable[[], bool] | None


def brennan_schwartz(
    lower: Vector, diagonal: Vector, upper: Vector, q: Vector, contact_first: bool
) -> Vector:
    """Return z from one elimination and one projected substitution of 0 <= z _|_ Mz + q >= 0.

    M is tridiagonal with bands `lower` (n - 1,), `diagonal` (n,), `upper` (n - 1,). With
    `contact_first`, elimination runs from the last row to the first and substitution with
    max(0, .) from the first to the last: exact for an M-matrix iff z = 0 on one run of indices
    that starts at index 0 (or nowhere). Otherwise the mirror image. Never above the solution.

    Raises
    ------
    ZeroDivisionError
        A pivot is zero; it cannot be for an M-matrix.

    Examples
    --------
    >>> minus_one, two = np.array([-1.0]), np.array([2.0, 2.0])
    >>> brennan_schwartz(minus_one, two, minus_one, np.array([1.0, -1.0]), True)
    array([0. , 0.5])
    """
    if not contact_first:
        return brennan_schwartz(upper[::-1], diagonal[::-1], lower[::-1], q[::-1], True)[::-1].copy()
    # Lists of Python floats: a sequential loop over NumPy scalars is several times slower.
    below, d, above, c = lower.tolist(), diagonal.tolist(), upper.tolist(), q.tolist()
    n = len(d)
    for i in range(n - 2, -1, -1):
        m = above[i] / d[i + 1]
        d[i] -= m * below[i]
        c[i] -= m * c[i + 1]
    z = [0.0] * n
    for i in range(n):
        residual = c[i] + below[i - 1] * z[i - 1] if i else c[i]
        z[i] = max(-residual / d[i], 0.0)  # in this order NaN stays NaN
    return np.array(z)


def policy_iteration(
    lower: Vector,
    diagonal: Vector,
    upper: Vector,
    q: Vector,
    basic_set: BoolVector,
    tolerance: float,
    max_systems: int,
    interrupt: Interrupt = None,
) -> tuple[Vector, int]:
    """Return (z, systems): the solution of 0 <= z _|_ Mz + q >= 0 with any contact set, for an M-matrix M.

    Each linear system has Mz + q = 0 on the basic set and z = 0 elsewhere; `basic_set` (n,) is the first
    guess. Then the rows with z < 0 leave the set and those with Mz + q < 0 enter it, where the violation is
    more than `tolerance` times the sum of the row's terms in size. z never falls from the second system on,
    so that n + 1 are enough. systems is max_systems + 1 where the limit was reached in vain.

    Raises
    ------
    ZeroDivisionError
        A pivot is zero; it cannot be for an M-matrix.

    Examples
    --------
    >>> minus_one, two = np.array([-1.0, -1.0]), np.array([2.0, 2.0, 2.0])
    >>> q, nothing = np.array([-2.0, 5.0, -4.0]), np.zeros(3, dtype=np.bool_)
    >>> policy_iteration(minus_one, two, minus_one, q, nothing, 1e-14, 9)
    (array([1., 0., 2.]), 2)
    """
    basic = basic_set.copy()
    z = np.zeros(q.size)
    for system in range(1, max_systems + 1):
        if interrupt is not None and system > 1 and interrupt():
            return np.maximum(z, 0.0), system
        z = _basic_point(lower, diagonal, upper, q, basic)
        terms = np.array([np.append(0.0, lower * z[:-1]), diagonal * z, np.append(upper * z[1:], 0.0), q])
        allowed = -tolerance * np.abs(terms).sum(axis=0)
        slack = terms.sum(axis=0)
        wrong = np.where(basic, np.abs(diagonal) * z < allowed, ~(slack >= allowed))  # NaN enters, and shows
        if not wrong.any():
            return np.maximum(z, 0.0), system
        basic ^= wrong
    return np.maximum(z, 0.0), max_systems + 1


def _basic_point(lower: Vector, diagonal: Vector, upper: Vector, q: Vector, basic: BoolVector) -> Vector:
    """Return z with Mz + q = 0 on the basic set and z = 0 elsewhere, by elimination without pivoting."""
    free, below, d, above, c = (part.tolist() for part in (basic, lower, diagonal, upper, q))
    n = len(d)
    z, factor = [0.0] * n, [0.0] * n
    for i in range(n):
        if free[i]:
            left = below[i - 1] if i else 0.0
            right = above[i] if i < n - 1 else 0.0
            pivot = d[i] - left * factor[i - 1]
            z[i], factor[i] = (-c[i] - left * z[i - 1]) / pivot, right / pivot
    for i in range(n - 2, -1, -1):
        if free[i]:
            z[i] -= factor[i] * z[i + 1]
    return np.array(z)


def projected_sor(
    lower: Vector,
    diagonal: Vector,
    upper: Vector,
    q: Vector,
    z: Vector,
    relaxation: float,
    tolerance: float,
    max_sweeps: int,
    interrupt: Interrupt = None,
) -> tuple[Vector, int]:
    """Return (z, sweeps): Gauss-Seidel sweeps with projection inside until |change|_inf <= tolerance.

    sweeps is max_sweeps + 1 where the limit was reached, or `interrupt` ended the work, without convergence.

    Raises
    ------
    ZeroDivisionError
        A diagonal entry is zero.

    Examples
    --------
    >>> one = np.array([1.0])
    >>> projected_sor(one[:0], 2.0 * one, one[:0], -4.0 * one, 0.0 * one, 1.0, 1e-12, 9)
    (array([2.]), 2)
    """
    below, d, above, c = lower.tolist(), diagonal.tolist(), upper.tolist(), q.tolist()
    x = z.tolist()
    n = len(d)
    for sweep in range(1, max_sweeps + 1):
        settled = True
        for i in range(n):
            row = c[i]
            if i > 0:
                row += below[i - 1] * x[i - 1]
            row += d[i] * x[i]
            if i < n - 1:
                row += above[i] * x[i + 1]
            new = max(x[i] - relaxation * (row / d[i]), 0.0)
            settled &= abs(new - x[i]) <= tolerance  # False for NaN
            x[i] = new
        if settled:
            return np.array(x), sweep
        if interrupt is not None and interrupt():
            break
    return np.array(x), max_sweeps + 1


def growing_basic_set(lower: Vector, diagonal: Vector, upper: Vector, q: Vector) -> BoolVector:
    """Return the basic set (w = 0, z > 0) of 0 <= z _|_ Mz + q >= 0 for a tridiagonal M-matrix; else a guess.

    The leading problems of order 1, 2, ... are solved in turn. z grows with each further row, so that a basic row
    remains basic: a new row with a negative slack starts a run or joins the last one, which then takes in the contact
    rows before it as long as their slacks are negative. Cost: O(n).

    Examples
    --------
    >>> minus_one, two = np.array([-1.0, -1.0]), np.array([2.0, 2.0, 2.0])
    >>> growing_basic_set(minus_one, two, minus_one, np.array([-2.0, 5.0, -4.0]))
    array([ True, False,  True])
    """
    below, d, above, c = [0.0, *lower.tolist()], diagonal.tolist(), [*upper.tolist(), 0.0], q.tolist()
    runs: list[_Run] = []

    def single(k: int) -> _Run:
        values = (-c[k] / d[k], -below[k] / d[k], -above[k] / d[k])
        return _Run(k, k, values, values)

    def with_left(run: _Run) -> _Run:
        return _joined(runs.pop(), run) if runs and runs[-1].to + 1 == run.start else run

    def end_before(k: int) -> float:
        return runs[-1].last[0] if runs and runs[-1].to + 1 == k else 0.0

    for k in range(len(c)):
        if c[k] + below[k] * end_before(k) >= 0.0:
            continue
        run = with_left(single(k))
        while (i := run.start - 1) >= 0 and c[i] + below[i] * end_before(i) + above[i] * run.first[0] < 0.0:
            run = with_left(_joined(single(i), run))
        runs.append(run)
    basic = np.zeros(len(c), dtype=np.bool_)
    for run in runs:
        basic[run.start : run.to + 1] = True
    return basic


@dataclass(frozen=True, slots=True)
class _Run:
    """Rows with w = 0 from start to `to`: its end values are a + b z_before + c z_after."""

    start: int
    to: int
    first: tuple[float, float, float]
    last: tuple[float, float, float]


def _joined(left: _Run, right: _Run) -> _Run:
    """Return the run of two neighbouring ones: the values at their border are eliminated."""
    (s, c, d), (p, a, b) = left.last, right.first
    det = 1.0 - d * a
    inner = ((s + d * p) / det, c / det, d * b / det)
    outer = ((p + a * s) / det, a * c / det, b / det)
    (p, a, b), (s, c, d) = left.first, right.last
    first = (p + b * outer[0], a + b * outer[1], b * outer[2])
    return _Run(left.start, right.to, first, (s + c * inner[0], c * inner[1], d + c * inner[2]))


def march_strikes(factors: Matrix, matrices: NDArray[np.float64], values: Matrix, obstacle: Matrix) -> Matrix:
    """Return the values after a march of American options, the first columns, and European ones, (nodes, columns).

    Parameters
    ----------
    factors : (steps, 2)
        Factors of the values now, and of those before, which are subtracted.
    matrices : (steps, 3, nodes)
        Lower, middle and upper diagonal of each step.
    values : (nodes, columns)
    obstacle : (nodes, american)
        Payoffs of the first columns, whose exercise region is at the first nodes.
    """
    now = before = values
    american = obstacle.shape[1]
    for (ahead, back), (lower, middle, upper) in zip(factors.tolist(), matrices, strict=True):
        before, now = now, ahead * now - back * before
        pivots = middle.copy()
        for node in range(middle.size - 2, -1, -1):
            share = upper[node] / pivots[node + 1]
            pivots[node] -= share * lower[node + 1]
            now[node] -= share * now[node + 1]
        held = np.ones(american, dtype=np.bool_)
        for node, pivot in enumerate(pivots.tolist()):
            if node > 0:
                now[node] -= lower[node] * now[node - 1]
            floor = obstacle[node]
            held &= (now[node, :american] <= pivot * floor) & (node < middle.size - 1)
            now[node] /= pivot
            free = np.maximum(now[node, :american], floor)
            now[node, :american] = np.where(held, floor, free)
    return now
