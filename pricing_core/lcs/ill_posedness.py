"""Witnesses of ill-posedness: states from which there is no solution, or more than one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.balancing import balancing_units
from pricing_core.lcs.modes import all_modes
from pricing_core.lcs.parts import independent_parts
from pricing_core.lcs.polynomial_problem import (
    ModeSolution,
    PolynomialProblem,
    has_other_states,
    polynomial_problem,
    same_input,
)
from pricing_core.lcs.rational_complementarity import all_solutions
from pricing_core.lcs.system import LCS
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS
from pricing_core.linalg.polynomials import RationalVector
from pricing_core.linalg.rational import as_fractions

LARGE = 1e4  # the s at which candidates are screened, in units in which the data are of order 1
SMALLEST = -1e-11  # what counts as nonnegative in the screening
MODES_EXAMINED = 6000  # in exact arithmetic, which bounds the number of candidates
MOST_CANDIDATES = 40
GRID = 729  # all vectors of -1, 0, 1 where there are no more


@dataclass(frozen=True, slots=True, eq=False)
class IllPosedness:
    """A state x0 and what the exact rational complementarity problem shows there.

    Parameters
    ----------
    x0 : Vector, shape (n,)
    kind : {"no solution", "several solutions"}
    solution_sets : tuple of tuples of int
        S(x0).
    """

    x0: Vector
    kind: Literal["no solution", "several solutions"]
    solution_sets: tuple[IndexSet, ...]


def find_ill_posedness(system: LCS, t: float = 0.0) -> IllPosedness | None:
    """Look for a state without solution or with several, and prove it; None proves nothing.

    Simple vectors are screened by LCP(q(s), G(s)) at one large s in floating point; where that does not have
    exactly one solution, S(x0) is computed exactly.

    Cost: for n = k = 10 about half a second; k <= 12.

    Examples
    --------
    >>> find_ill_posedness(LCS([[0]], [[-1]], [[1]])).kind
    'no solution'
    """
    k = system.shape[1]
    budget = min(MOST_CANDIDATES, max(4, MODES_EXAMINED >> k))
    candidates = np.array(list(_candidates(system)))
    numbers, all_regular = _number_of_solutions(system, candidates, t)
    suspicious = numbers != 1
    if not all_regular:
        suspicious[0] = True  # the origin, where singular modes may leave the state open
        budget = max(2, budget // 4)  # each of them costs a linear programme
    for x0 in candidates[suspicious][:budget]:
        shown = shows_ill_posedness(system, x0, t)
        if shown is not None:
            return shown
    return None


def shows_ill_posedness(system: LCS, x0: ArrayLike, t: float = 0.0) -> IllPosedness | None:
    """Return what S(x0) proves against well-posedness, or None.

    Two solutions count where both go on without impulses, from x0 or from the states after their jumps, and
    differ.
    """
    problem = polynomial_problem(system, x0, t)
    solutions = all_solutions(problem)
    sets = tuple(solution.mode for solution in solutions)
    start = np.array([float(value) for value in problem.x0])
    if not solutions:
        return IllPosedness(start, "no solution", sets)
    if _motions_differ(system, problem, solutions, t) or any(
        solution.multiplier(problem).is_strictly_proper() and has_other_states(solution, problem.system.B)
        for solution in solutions
    ):
        return IllPosedness(start, "several solutions", sets)
    return None


def ambiguous_pairs(system: LCS, x0: ArrayLike, t: float = 0.0) -> IndexSet | None:
    """Return the pairs of an independent part that is proved to go on from x0 in several ways, None where none is.

    Parts of more than 12 pairs are not examined. The part goes on in several ways; whether the others go on at all is
    not asked.

    Examples
    --------
    >>> ambiguous_pairs(LCS([[0, 1], [-1, 0]], [[0], [-1]], [[0, 1]]), [0, 1])
    (0,)
    """
    start = np.asarray(x0)
    for part in independent_parts(system):
        if part.pairs and len(part.pairs) <= LARGEST_PAIRS:
            shown = shows_ill_posedness(part.system, start[list(part.states)], t)
            if shown is not None and shown.kind == "several solutions":
                return part.pairs
    return None


def _motions_differ(system: LCS, problem: PolynomialProblem, solutions: list[ModeSolution], t: float) -> bool:
    """Tell whether two of the solutions go on after at most one jump, and differently."""
    seen: list[ModeSolution] = []
    first: RationalVector | None = None
    for solution in solutions:
        if any(same_input(solution, other) for other in seen):
            continue
        seen.append(solution)
        motion = _motion(system, problem, solution, t)
        if first is None:
            first = motion
        elif motion is not None and not first.same_smooth_part(motion):
            return True
    return False


def _motion(
    system: LCS, problem: PolynomialProblem, solution: ModeSolution, t: float
) -> RationalVector | None:
    """Return the state, after its jump if it has one; None where it is not known to go on from there."""
    state = solution.state(problem)
    if solution.multiplier(problem).is_strictly_proper():
        return state
    landed = np.array(state.exact_initial_value(), dtype=object)
    after = polynomial_problem(system, as_fractions(landed), t)
    smooth = (f.state(after) for f in all_solutions(after) if f.multiplier(after).is_strictly_proper())
    return next(smooth, None)


def _candidates(system: LCS) -> Iterator[Vector]:
    """Return the origin, rows of C, columns of B, unit vectors, solutions of Cx = +-1, and small integer vectors."""
    n, k = system.shape
    yield np.zeros(n)
    directions = [*system.C, *system.B.T, *np.eye(n)]
    signs = [np.array(pattern) for pattern in product((-1.0, 1.0), repeat=min(k, 5))]
    padded = [np.resize(pattern, k) for pattern in signs]
    directions += list(np.round(np.linalg.pinv(system.C) @ np.array(padded).T, 6).T)
    if 3**n <= GRID:
        directions += [np.array(point) for point in product((-1.0, 0.0, 1.0), repeat=n)]
    for direction in directions:
        if direction.any():
            for factor in (-1.0, 1.0, -1000.0, 1000.0):
                yield factor * direction


def _number_of_solutions(system: LCS, states: Matrix, t: float) -> tuple[Vector, bool]:
    """Return for each state how many multipliers solve LCP(q(s), G(s)) at one s; and whether all G_II are regular."""
    units = balancing_units(system.A, system.B, system.C, system.D)
    A, B, C, D = units.apply(system.A, system.B, system.C, system.D)
    n, k = system.shape
    f, g = system.f.after(t) / (units.rate * units.state), system.g.after(t) * units.pair
    resolvent = np.linalg.inv(LARGE * np.eye(n) - A)
    M = C @ resolvent @ B + D
    q = C @ resolvent @ ((states / units.state).T + f[:, None] / LARGE) + g[:, None] / LARGE
    sizes = np.abs(M).max(axis=1, initial=0.0)
    M, q = M / np.where(sizes > 0, sizes, 1.0)[:, None], q / np.where(sizes > 0, sizes, 1.0)[:, None]
    found: list[list[Vector]] = [[] for _ in states]
    all_regular = True
    for mode in all_modes(k):
        inside = list(mode)
        part = M[np.ix_(inside, inside)]
        if inside and np.linalg.cond(part) > 1.0 / np.finfo(float).eps:
            all_regular = False
            continue
        u = np.zeros_like(q)
        u[inside] = np.linalg.solve(part, -q[inside])
        y = M @ u + q
        y[inside] = 0.0
        scale = 1.0 + np.abs(u).max(axis=0, initial=0.0) + np.abs(q).max(axis=0, initial=0.0)
        feasible = (u >= SMALLEST * scale).all(axis=0) & (y >= SMALLEST * scale).all(axis=0)
        for column in np.flatnonzero(feasible):
            if not any(
                np.allclose(u[:, column], other, atol=1e-9 * scale[column]) for other in found[column]
            ):
                found[column].append(u[:, column])
    return np.array([len(multipliers) for multipliers in found]), all_regular
