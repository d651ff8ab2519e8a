"""Linear-quadratic optimal control with state constraints, section 11.2.3."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_matrix, as_square_matrix, as_vector
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.system import LCS
from pricing_core.models.control.problem import (
    ROUNDING,
    LQData,
    constraint_orders,
    hamiltonian_system,
    start_derivatives,
)
from pricing_core.models.control.resolve import resolve
from pricing_core.models.control.solution import OptimalControl, solved, unresolved

FEWEST_INTERVALS, MOST_INTERVALS = 8, 20_000
LARGEST = 1e50
LONGEST = 1e5  # time constants of the system, the fastest


@dataclass(frozen=True, slots=True, eq=False)
class StateConstrainedLQ:
    """Minimise (1/2) int_0^T (x^T Q x + u^T u) dt, x' = A x + B u, x(0) = x0, C x >= bound (11.21)-(11.23).

    Parameters
    ----------
    A : array_like, shape (n, n)
    B : array_like, shape (n, m)
    C : array_like, shape (k, n)
    Q : array_like, shape (n, n)
        Symmetric, positive semidefinite.
    x0 : array_like, shape (n,)
        With C x0 >= bound; where a slack is zero, the first of its derivatives that is not must be positive, up to
        the one that the control enters.
    horizon : float
        T > 0.
    bound : array_like, shape (k,), optional
        Zero where missing, as in (11.23).

    Raises
    ------
    InvalidInputError
        Naming the argument.

    Examples
    --------
    From 2 towards 0, stopped at 1 (the junction is at arccosh(2)/sqrt(2)):

    >>> answer = StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [2], 3.0, bound=[1]).solve()
    >>> print(f"{answer.cost:.9f} {answer.switching_times[0]:.9f}", answer.status)
    3.018259883 0.931229859 solved
    >>> [(time, weights.round(9).tolist()) for time, weights in answer.multiplier_atoms]
    [(3.0, [1.0])]
    """

    A: Matrix
    B: Matrix
    C: Matrix
    Q: Matrix
    x0: Vector
    horizon: float
    bound: Vector

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        Q: ArrayLike,
        x0: ArrayLike,
        horizon: float,
        bound: ArrayLike | None = None,
    ) -> None:
        a = as_square_matrix("A", A)
        n = a.shape[0]
        if n == 0:
            raise InvalidInputError("A", f"shape {a.shape}", "a square matrix of at least one row")
        b, c = as_matrix("B", B), as_matrix("C", C)
        if b.shape[0] != n or b.shape[1] == 0:
            raise InvalidInputError("B", f"shape {b.shape}", f"a matrix of {n} rows and at least one column")
        if c.shape[1] != n:
            raise InvalidInputError("C", f"shape {c.shape}", f"a matrix of {n} columns")
        weight = as_matrix("Q", Q, (n, n))
        limit = as_vector("bound", np.zeros(c.shape[0]) if bound is None else bound, c.shape[0])
        length = float(as_vector("horizon", [horizon])[0])
        if length <= 0.0:
            raise InvalidInputError("horizon", horizon, "a positive number")
        start = as_vector("x0", x0, n)
        arrays = {"A": a, "B": b, "C": c, "Q": weight, "x0": start, "bound": limit}
        for name, array in arrays.items():
            _check_size(name, array)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "Q", _semidefinite(weight))
        object.__setattr__(self, "horizon", length)
        _check_start(self._data)
        speed = float(np.max(np.abs(np.linalg.eigvals(self.to_lcs().A))))
        if length * speed > LONGEST:
            raise InvalidInputError(
                "horizon", horizon, f"at most {LONGEST / speed:.3g}: {LONGEST:g} time constants"
            )

    @property
    def _data(self) -> LQData:
        return LQData(self.A, self.B, self.C, self.Q, self.x0, self.bound, self.horizon)

    @property
    def constraint_orders(self) -> tuple[int | None, ...]:
        """For each constraint the first derivative that the control enters; None where it never does."""
        return constraint_orders(self._data)

    def to_lcs(self) -> LCS:
        """Return (11.25), whose solution is sought with x(0) and lambda(T+) given: not an initial value problem.

        Examples
        --------
        >>> StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [2], 3.0, bound=[1]).to_lcs().B
        array([[ 0.],
               [-1.]])
        """
        return hamiltonian_system(self._data)

    def solve(self, *, intervals: int = 200) -> OptimalControl:
        """Find the optimal control, its state, its multipliers and the times at which constraints join and leave.

        Collocation on equal intervals tells which constraints are active when; shooting on (11.25) finds the
        junction times and the atoms of the multiplier to about 1e-11; then every sign is checked on a fine grid, and
        the structure corrected where one is wrong. The problem is convex: what satisfies (11.25) is the optimum.

        Parameters
        ----------
        intervals : int
            Number of intervals of the collocation, from 8 to 20000; four times as many where the structure is
            not found at first.

        Returns
        -------
        OptimalControl
            With status "structure not resolved" where the contacts could not be told apart, as where touch points
            accumulate (order >= 3) or active constraints depend on one another: then the values are collocation's.

        Raises
        ------
        InvalidInputError
            `intervals` out of range.
        InfeasibleError
            No control satisfies the constraints: proved by a combination of them that the control does not reach.
        NumericalError
            No control was found, or none that keeps the constraints to 1e-6 of the size of the data; where the dual ray
            proves that any control that satisfies them is of a certain size, the message says so.

        Notes
        -----
        Cost: the quadratic programme, linear in `intervals`; then per shooting step a least-squares problem in about
        2n unknowns per segment. Source: (11.24)-(11.25), with eta a measure; Hartl, Sethi, Vickson 1995.
        """
        if not isinstance(intervals, int) or not FEWEST_INTERVALS <= intervals <= MOST_INTERVALS:
            allowed = f"a whole number from {FEWEST_INTERVALS} to {MOST_INTERVALS}"
            raise InvalidInputError("intervals", intervals, allowed)
        lengths = np.linalg.norm(self.C, axis=1)
        lengths[lengths == 0.0] = 1.0
        data = replace(self._data, C=self.C / lengths[:, None], bound=self.bound / lengths)
        coarse, found = resolve(data, intervals)
        if found is None:
            assert coarse is not None  # it was computed where nothing simpler was the answer
            answer = unresolved(data, coarse)
        else:
            answer = solved(data, found)
        atoms = tuple((time, weights / lengths) for time, weights in answer.multiplier_atoms)
        return replace(answer, multiplier=answer.multiplier / lengths, multiplier_atoms=atoms)


def _check_size(name: str, array: Vector | Matrix) -> None:
    """Refuse numbers whose products leave the range of floating point."""
    largest = float(np.max(np.abs(array), initial=0.0))
    if largest > LARGEST:
        raise InvalidInputError(name, largest, f"of entries up to {LARGEST:g}: the cost squares them")


def _semidefinite(Q: Matrix) -> Matrix:
    size = float(np.max(np.abs(Q), initial=0.0))
    if float(np.max(np.abs(Q - Q.T), initial=0.0)) > ROUNDING * size:
        raise InvalidInputError("Q", Q.tolist(), "a symmetric matrix")
    lowest = float(np.linalg.eigvalsh(Q)[0]) if Q.size else 0.0
    if lowest < -ROUNDING * Q.shape[0] * size:
        allowed = f"positive semidefinite; its lowest eigenvalue is {lowest:.6g}"
        raise InvalidInputError("Q", Q.tolist(), allowed)
    return as_matrix("Q", 0.5 * (Q + Q.T))


def _check_start(data: LQData) -> None:
    """Refuse an x0 at which a slack is negative or turns negative whatever the control does."""
    for i, order in enumerate(constraint_orders(data)):
        for derivative, (value, size) in enumerate(start_derivatives(data, i, order or data.states)):
            if value < -ROUNDING * size:
                what = "slack" if derivative == 0 else f"derivative {derivative} of the vanishing slack"
                allowed = f"a state with C x0 >= bound that can stay there; {what} {i} is {value:.6g}"
                raise InvalidInputError("x0", data.x0.tolist(), allowed)
            if value > ROUNDING * size:
                break
