"""The rational complementarity problem (11.77): which modes may follow from a state, the set S(x0)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from flint import fmpq, fmpq_poly, fmpz_poly
from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, check_type
from pricing_core.errors import InvalidInputError, RayTerminationError
from pricing_core.lcp.polynomial_lemke import solve_polynomial_lemke
from pricing_core.lcs.modes import all_modes
from pricing_core.lcs.pole_shifted_passivity import is_passive_after_pole_shift
from pricing_core.lcs.polynomial_problem import (
    ModeSolution,
    PolynomialProblem,
    has_other_inputs,
    has_other_states,
    mode_solution,
    polynomial_problem,
)
from pricing_core.lcs.system import LCS
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS
from pricing_core.linalg.polynomials import RationalVector, sign_at_infinity
from pricing_core.linalg.principal_minors import members_of, principal_solutions
from pricing_core.linalg.rational import exact_kernel

LARGEST_COMPLETE = 16  # pairs up to which all modes are examined


@dataclass(frozen=True, slots=True, eq=False)
class RationalComplementarity:
    """S(x0) and the multipliers that belong to its index sets.

    Parameters
    ----------
    solution_sets : tuple of tuples of int
        The I for which some 0 <= y(s) _|_ u(s) >= 0 has y_i = 0 for i in I and u_i = 0 outside; by size, then
        in lexicographic order. Only one of them where `complete` is False.
    multipliers : tuple of RationalVector
        The Laplace transform of one multiplier for each set.
    unique_state, unique_input : bool or None
        Whether all solutions have the same x(t) for t > 0 up to the next event, and the same u(s): True where
        there is none, None where `complete` is False.
    complete : bool
    """

    solution_sets: tuple[IndexSet, ...]
    multipliers: tuple[RationalVector, ...]
    unique_state: bool | None
    unique_input: bool | None
    complete: bool


def rational_complementarity(
    system: LCS, x0: ArrayLike, *, complete: bool = True, t: float = 0.0
) -> RationalComplementarity:
    """Solve the rational complementarity problem (11.77) from x0, with ">= 0 for all sufficiently large s".

    Every mode is decided in exact arithmetic, those with singular G_II by a linear programme over the ordered
    field of rational functions. All numbers are taken for the rationals that
    `pricing_core.linalg.rational.rational` states. x0 = 0 without offsets is solved by every index set.

    Parameters
    ----------
    system : LCS
        The offsets f, g are taken as constant from t on.
    x0 : array_like, shape (n,)
        The state before a possible jump.
    complete : bool
        True finds all index sets, for k <= 16. False follows Lemke's path to one of them, for any k.
    t : float
        The time at which f(t+), g(t+) are taken.

    Raises
    ------
    InvalidInputError
        x0 does not fit, or k > 16 and `complete` is True.
    RayTerminationError
        `complete` is False, and Lemke's path ended on a ray: nothing is proved.

    Notes
    -----
    Cost: 2**k times about 3 k products of polynomials of degree n: 0.1 s for n = k = 10 and integer data, more
    with every singular mode, and some 20 s for k = 16; where the multiplier is unique because the system is passive
    after a shift of its poles, one path of Lemke's method serves k > 12. Source: Heemels, Schumacher, Weiland 1999.

    Examples
    --------
    Two integrators that help each other have three ways on:

    >>> rational_complementarity(LCS([[0, 0], [0, 0]], [[1, 2], [2, 1]], [[1, 0], [0, 1]]), [-1, -1]).solution_sets
    ((0,), (1,), (0, 1))
    """
    check_type("system", system, LCS)
    problem = polynomial_problem(system, x0, t)
    if not complete:
        solution = _one_solution(problem)
        return RationalComplementarity((solution.mode,), (solution.multiplier(problem),), None, None, False)
    solutions = all_solutions(problem)
    return RationalComplementarity(
        tuple(solution.mode for solution in solutions),
        tuple(solution.multiplier(problem) for solution in solutions),
        has_unique_state(problem, solutions),
        has_unique_input(solutions),
        True,
    )


def all_solutions(problem: PolynomialProblem) -> list[ModeSolution]:
    """Return a solution for every index set that has one, by size, then in lexicographic order.

    Raises
    ------
    InvalidInputError
        k > 16.
    """
    k = len(problem.q)
    if k > LARGEST_COMPLETE:
        raise InvalidInputError(
            "k", k, f"at most {LARGEST_COMPLETE} for all 2**k modes: use complete=False, or name a mode"
        )
    only = _only_solution(problem) if k > LARGEST_PAIRS else None
    if only is not None:
        return _in_every_mode(problem, only)
    solutions = {solution.mode: solution for solution in _solutions(problem)}
    return [solutions[mode] for mode in all_modes(k) if mode in solutions]


def _only_solution(problem: PolynomialProblem) -> ModeSolution | None:
    """Return the one solution where passivity after a shift of the poles makes u unique, None otherwise."""
    B, D = problem.system.B, problem.system.D
    if not is_passive_after_pole_shift(problem.system) or exact_kernel(np.vstack([B, D + D.T])).shape[1]:
        return None
    try:
        return _one_solution(problem)
    except RayTerminationError:
        return None


def _in_every_mode(problem: PolynomialProblem, only: ModeSolution) -> list[ModeSolution]:
    """Return the solution with every mode that it belongs to: its u vanishes outside, its y inside."""
    k, u, d = len(problem.q), only.u, only.d
    vanishing = [
        i
        for i in range(k)
        if not d * problem.q[i] + sum((a * b for a, b in zip(problem.N[i], u, strict=True)), fmpz_poly())
    ]
    free = [i for i in vanishing if not u[i]]
    modes = [
        tuple(sorted((*only.mode, *others)))
        for count in range(len(free) + 1)
        for others in combinations(free, count)
    ]
    return [ModeSolution(mode, u, d) for mode in sorted(modes, key=lambda mode: (len(mode), mode))]


def has_unique_input(solutions: list[ModeSolution]) -> bool:
    """Tell whether all solutions, those inside the modes included, have the same u(s)."""
    return _all_equal([(solution.u, solution.d) for solution in solutions]) and not any(
        map(has_other_inputs, solutions)
    )


def has_unique_state(problem: PolynomialProblem, solutions: list[ModeSolution]) -> bool:
    """Tell whether all have the same x(s) = (sI - A)^-1 (x0 + B u(s)), impulses of x apart."""
    B = problem.system.B
    responses = [([_product(row, solution.u) for row in B], solution.d) for solution in solutions]
    if not _all_equal(responses):
        first = solutions[0].state(problem)
        if not all(first.same_smooth_part(solution.state(problem)) for solution in solutions[1:]):
            return False
    return not any(has_other_states(solution, B) for solution in solutions)


def _one_solution(problem: PolynomialProblem) -> ModeSolution:
    u, d = solve_polynomial_lemke(problem.p, problem.N, problem.q)
    return ModeSolution(tuple(i for i, value in enumerate(u) if value), u, d)


def _solutions(problem: PolynomialProblem) -> Iterator[ModeSolution]:
    """Yield a solution of every mode that has one: by shared elimination, and one by one where that fails."""
    k = len(problem.q)
    seen = set()
    for members, minor, column in principal_solutions(problem.p, problem.N, problem.q):
        seen.add(members)
        orientation = sign_at_infinity(minor)
        signs = [orientation * sign_at_infinity(entry) for entry in column]
        if all(sign <= 0 if members >> i & 1 else sign >= 0 for i, sign in enumerate(signs)):
            factor = fmpz_poly([-orientation])
            u = [factor * entry if members >> i & 1 else fmpz_poly() for i, entry in enumerate(column)]
            yield ModeSolution(members_of(members, k), u, orientation * minor)
    for members in range(1 << k):
        if members not in seen:
            solution = mode_solution(problem, members_of(members, k))
            if solution is not None:
                yield solution


def _all_equal(vectors: Sequence[tuple[Sequence[fmpz_poly | fmpq_poly], fmpz_poly]]) -> bool:
    """Tell whether all (numerators, denominator) are the same rational functions."""
    if not vectors:
        return True
    first, d = vectors[0]
    return all(
        a * other_d == b * d for other, other_d in vectors[1:] for a, b in zip(first, other, strict=True)
    )


def _product(row: list[fmpq], u: list[fmpz_poly]) -> fmpq_poly:
    return sum((b * fmpq_poly(p) for b, p in zip(row, u, strict=True) if b), fmpq_poly())
