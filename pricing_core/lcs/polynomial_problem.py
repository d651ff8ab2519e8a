"""The rational complementarity problem (11.77) in polynomials, and its solution in one mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_poly, fmpz_poly
from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, as_array, as_vector
from pricing_core.lcs.rational_system import RationalSystem, rational_offsets, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.transfer_matrix import polynomial_transfer
from pricing_core.linalg.polynomial_tableau import Tableau, can_increase, feasible, with_zero_basics
from pricing_core.linalg.polynomials import RationalVector, common_denominator
from pricing_core.linalg.principal_minors import PolynomialMatrix
from pricing_core.linalg.rational import RationalMatrix, rational_array


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialProblem:
    """p y = q + N u with 0 <= y _|_ u >= 0 for all sufficiently large s, (11.77) times positive factors.

    Parameters
    ----------
    system : RationalSystem
    x0, f : arrays of rationals, shape (n,)
    p : fmpz_poly
        Positive for large s.
    N : list of list of fmpz_poly, (k, k)
    q : list of fmpz_poly, (k,)
    input_scale : fmpq_poly
        u of this problem is input_scale times the transform of the multiplier, positive for large s.
    """

    system: RationalSystem
    x0: RationalMatrix
    f: RationalMatrix
    p: fmpz_poly
    N: PolynomialMatrix
    q: list[fmpz_poly]
    input_scale: fmpq_poly


@dataclass(frozen=True, slots=True, eq=False)
class ModeSolution:
    """A solution of the problem with y_i = 0 for i in the mode and u_i = 0 outside.

    Parameters
    ----------
    mode : tuple of int
    u : list of fmpz_poly, (k,)
        Numerators over d.
    d : fmpz_poly
        Positive for large s.
    others : Tableau or None
        The polyhedron of all solutions in this mode, at u; None where u is the only one.
    """

    mode: IndexSet
    u: list[fmpz_poly]
    d: fmpz_poly
    others: Tableau | None = None

    def multiplier(self, problem: PolynomialProblem) -> RationalVector:
        """Return the Laplace transform of the multiplier (11.82)."""
        numerators = tuple(fmpq_poly(entry) for entry in self.u)
        return RationalVector(numerators, fmpq_poly(self.d) * problem.input_scale)

    def state(self, problem: PolynomialProblem) -> RationalVector:
        """Return the Laplace transform of the state (11.81): (sI - A)^-1 (x0 + f / s + B u)."""
        A, B, *_ = problem.system
        u = self.multiplier(problem)
        s = fmpq_poly([0, 1])
        common = u.denominator * s
        right = [
            common * x
            + (common // s) * f
            + s * sum((b * p for b, p in zip(row, u.numerators, strict=True)), fmpq_poly())
            for x, f, row in zip(problem.x0, problem.f, B, strict=True)
        ]
        resolvent, characteristic = _resolvent(A)
        numerators = (sum((a * p for a, p in zip(row, right, strict=True)), fmpq_poly()) for row in resolvent)
        return RationalVector(tuple(numerators), common * characteristic)


def polynomial_problem(system: LCS, x0: ArrayLike, t: float) -> PolynomialProblem:
    """Return the problem of x' = Ax + Bu + f(t+), y = Cx + Du + g(t+) from x0, f and g steps at t."""
    n = system.shape[0]
    given = as_array("x0", x0)
    as_vector("x0", given, n)
    data = rational_system(system)
    start = rational_array(given)
    f, g = rational_offsets(system, t)
    scale = common_denominator([*start, *f, *g])
    p, N, M, row_scale = polynomial_transfer(data, scale * np.column_stack([start, f]))
    if f.any() or g.any():
        s = fmpz_poly([0, 1])
        offsets = [fmpq(scale * c * offset).p for c, offset in zip(row_scale, g, strict=True)]
        q = [s * row[0] + row[1] + offset * p for row, offset in zip(M, offsets, strict=True)]
        return PolynomialProblem(data, start, f, p, N, q, fmpq_poly([0, scale]))
    return PolynomialProblem(data, start, f, p, N, [row[0] for row in M], fmpq_poly([scale]))


def mode_solution(problem: PolynomialProblem, mode: IndexSet) -> ModeSolution | None:
    """Return a solution with y_i = 0 for i in the mode and u_i = 0 outside, or None: proved that there is none.

    G_II may be singular: the question is a linear programme over the ordered field of rational functions.

    Cost: k products of polynomials for every entry of a (k, |I|) table, times a few for singular G_II.
    """
    k = len(problem.q)
    rows = [[*(-problem.N[i][j] for j in mode), problem.q[i]] for i in range(k)]
    start = Tableau(problem.p, rows, tuple(range(k, 2 * k)), mode)  # p y - N u = q
    reduced = with_zero_basics(start, frozenset(k + i for i in mode))
    point = None if reduced is None else feasible(reduced)
    if point is None:
        return None
    values = dict(zip(point.basic, (row[-1] for row in point.rows), strict=True))
    u = [values.get(j, fmpz_poly()) for j in range(k)]
    return ModeSolution(mode, u, point.d, point if point.nonbasic else None)


def same_input(first: ModeSolution, second: ModeSolution) -> bool:
    """Tell whether two solutions of one problem have the same u."""
    return all(a * second.d == b * first.d for a, b in zip(first.u, second.u, strict=True))


def has_other_inputs(solution: ModeSolution) -> bool:
    """Tell whether the mode has another solution than this one."""
    point, one = solution.others, fmpz_poly([1])
    return point is not None and can_increase(point, dict.fromkeys(point.nonbasic, one))


def has_other_states(solution: ModeSolution, B: RationalMatrix) -> bool:
    """Tell whether the mode has a solution with another B u, and hence another state."""
    point = solution.others
    if point is None:
        return False
    for row in B:
        scale = common_denominator(row)
        for sign in (scale, -scale):
            functional = {j: fmpz_poly([fmpq(sign * row[j]).p]) for j in solution.mode if row[j]}
            if functional and can_increase(point, functional):
                return True
    return False


def _resolvent(A: RationalMatrix) -> tuple[list[list[fmpq_poly]], fmpq_poly]:
    """Return adj(sI - A) and det(sI - A)."""
    n = A.shape[0]
    zero = np.full((n, n), fmpq(0), dtype=object)
    identity = rational_array(np.eye(n, dtype=int))
    p, _, M, _ = polynomial_transfer(RationalSystem(A, zero, identity, zero), identity)
    factor = fmpq(1) / p.leading_coefficient() if n else fmpq(1)
    return [[fmpq_poly(entry) * factor for entry in row] for row in M], fmpq_poly(p) * factor
