"""Complementarity problems in rational arithmetic, for the floating-point numbers as they are given."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from flint import fmpz

from pricing_core.arrays import Matrix, Vector, check_type
from pricing_core.errors import (
    InfeasibleError,
    InvalidInputError,
    IterationLimitError,
    NumericalError,
    RayTerminationError,
)
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.polynomial_lemke import solve_polynomial_lemke
from pricing_core.lcp.problem import LCP, LCPSolution, solution_of
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.determinant import whole_numbers
from pricing_core.linalg.equilibration import equilibration
from pricing_core.linalg.polynomial_tableau import Tableau, can_increase, feasible, with_zero_basics

LARGEST_EXACT_ORDER = 60  # a path takes seconds there
LARGEST_SEARCHED_ORDER = 20  # the search may meet 2**n cells
MOST_NODES = 20_000


class ExactProblem(NamedTuple):
    """Equations over x = (w, z) >= 0 in whole numbers; z = value * 2**exponent, and so is w.

    The tableau is that of the equations for the pairs (i, n + i), of which one shall be zero.
    """

    tableau: Tableau
    exponents: tuple[int, ...]  # (2 n,)

    @property
    def pairs(self) -> int:
        """The number of pairs n."""
        return len(self.exponents) // 2

    def values(self, tableau: Tableau) -> list[Fraction]:
        """Return x = (w, z) at the point of a tableau of these variables, whose nonbasic ones are zero."""
        at = {
            v: Fraction(int(row[-1]), int(tableau.d))
            for v, row in zip(tableau.basic, tableau.rows, strict=True)
        }
        return [at.get(v, Fraction()) * Fraction(2) ** e for v, e in enumerate(self.exponents)]


def exact_problem(problem: LCP) -> ExactProblem:
    """Return an LCP in whole numbers, equilibrated, with w basic.

    Examples
    --------
    >>> exact_problem(LCP([[0.5]], [-3.0])).tableau.rows
    [[-4, -3]]
    """
    n, M = problem.size, problem.dense()
    sizes = (int(np.frexp(np.max(np.abs(part), initial=0.0))[1]) for part in (M, problem.q))
    column = [*np.log2(equilibration(M)[1]).astype(int).tolist(), next(sizes) - next(sizes)]
    rows, exponents = [], []
    for left, right in zip(M.tolist(), problem.q.tolist(), strict=True):
        row, exponent = whole_numbers([*(-value for value in left), right], column)
        rows.append(row)
        exponents.append(exponent)
    first = Tableau(fmpz(1), rows, tuple(range(n)), tuple(range(n, 2 * n)))
    # q was divided by its size beside M's, and so were all unknowns.
    return ExactProblem(first, tuple(e - column[-1] for e in [*exponents, *column[:n]]))


def solve_exact(problem: LCP, *, time_limit: float | None = None) -> LCPSolution:
    """Solve an LCP with n <= 60 by Lemke's method in rational arithmetic on the numbers as they are given.

    Where the path ends on a ray, a certificate of infeasibility is looked for, and for n <= 20 the complementary cells
    are searched one by one, also in rational arithmetic.

    Parameters
    ----------
    problem : LCP
    time_limit : float, optional
        Seconds.

    Returns
    -------
    LCPSolution
        z rounded to floating-point numbers, so that the residual is at rounding level but need not be zero.

    Raises
    ------
    InfeasibleError
        Proved: there is no solution.
    RayTerminationError
        The path ended on a ray, and nothing is proved.
    IterationLimitError
        The time is over, or the search met more than 20 000 cells.
    NumericalError
        A component of the solution lies outside the range of floating-point numbers.
    InvalidInputError
        n > 60.

    Notes
    -----
    Cost: milliseconds for n = 10, seconds for n = 60. Source: Cottle, Pang, Stone 1992, sections 4.4 and 4.9.

    Examples
    --------
    >>> solve_exact(LCP([[1.0, -1.0], [-1.0, 1.0 + 2.0**-40]], [-1.0, 0.5])).z
    array([5.49755814e+11, 5.49755814e+11])
    """
    check_type("problem", problem, LCP)
    limit = TimeLimit(time_limit)
    if problem.size > LARGEST_EXACT_ORDER:
        allowed = f"of order at most {LARGEST_EXACT_ORDER} in exact arithmetic"
        raise InvalidInputError("M", f"a matrix of order {problem.size}", allowed)
    posed = exact_problem(problem)
    try:
        x = values_by_lemke(posed, posed.tableau, limit)
    except RayTerminationError:
        if problem.size <= LARGEST_SEARCHED_ORDER:
            x = values_by_search(posed, limit)
        elif infeasibility_certificate(problem) is not None:
            raise InfeasibleError("no z >= 0 has M z + q >= 0: a combination of its rows proves it") from None
        else:
            raise
    return solution_of(problem, rounded(x[problem.size :]), 0, "exact")


def rounded(x: list[Fraction]) -> Vector:
    """Return the nearest floating-point numbers.

    Raises
    ------
    NumericalError
        A number is too large.
    """
    try:
        return np.array([float(value) for value in x])
    except OverflowError:
        raise NumericalError(
            "the solution has a component beyond the range of floating-point numbers: choose other units"
        ) from None


def values_by_lemke(posed: ExactProblem, tableau: Tableau, time_limit: TimeLimit) -> list[Fraction]:
    """Return (w, z) by Lemke's method from a tableau with one basic variable of each pair.

    Raises
    ------
    RayTerminationError
        The path ended on a ray, and nothing is proved.
    """
    n = posed.pairs
    order = sorted(range(n), key=lambda r: tableau.basic[r] % n)
    columns = [tableau.nonbasic.index((tableau.basic[r] + n) % (2 * n)) for r in order]
    N = [[-tableau.rows[r][c] for c in columns] for r in order]
    q = [tableau.rows[r][-1] for r in order]
    numerators, denominator = solve_polynomial_lemke(tableau.d, N, q, time_limit=time_limit)
    x = [Fraction()] * (2 * n)
    for i, (row, right, c) in enumerate(zip(N, q, columns, strict=True)):
        slack = sum((a * b for a, b in zip(row, numerators, strict=True)), right * denominator)
        basic, other = tableau.basic[order[i]], tableau.nonbasic[c]
        x[basic] = Fraction(int(slack), int(denominator * tableau.d))
        x[other] = Fraction(int(numerators[i]), int(denominator))
    return [value * Fraction(2) ** e for value, e in zip(x, posed.exponents, strict=True)]


def values_by_search(posed: ExactProblem, time_limit: TimeLimit) -> list[Fraction]:
    """Return (w, z) of the first solution that a search of the complementary cells meets.

    Raises
    ------
    InfeasibleError
        No cell holds a point: there is no solution.
    IterationLimitError
        The time is over, or there are more than 20 000 cells.
    """
    found = next(complementary_points(posed.tableau, posed.pairs, time_limit), None)
    if found is None:
        raise InfeasibleError(
            "a complete enumeration of the complementary cells, in exact arithmetic, shows that there is no solution"
        )
    return posed.values(found)


def complementary_points(tableau: Tableau, n: int, time_limit: TimeLimit) -> Iterator[Tableau]:
    """Yield feasible tableaux at whose point one variable of each pair (i, n + i) is zero.

    There is none iff the equations have no solution with that property.

    Raises
    ------
    IterationLimitError
        The time is over, or there are more than 20 000 cells.
    """
    stack: list[tuple[Tableau | None, frozenset[int]]] = [(tableau, frozenset(range(n)))]
    for _ in range(MOST_NODES):
        if not stack:
            return
        time_limit.check("the search of the complementary cells")
        cell, open_pairs = stack.pop()
        cell = None if cell is None else feasible(cell)
        if cell is None:
            continue
        positive = {v for v, row in zip(cell.basic, cell.rows, strict=True) if row[-1] > 0}
        wrong = [i for i in open_pairs if i in positive and n + i in positive]
        if not wrong:
            yield cell
        if open_pairs:
            i = min(wrong or open_pairs)
            stack += [(without(cell, v), open_pairs - {i}) for v in (n + i, i)]
    raise IterationLimitError(
        f"the search in exact arithmetic met more than {MOST_NODES} complementary cells"
    )


class ExactCell(NamedTuple):
    """A polyhedron of solutions: the tableau of a point of it, and the variables that are zero all over it."""

    tableau: Tableau
    zeros: frozenset[int]

    @property
    def is_point(self) -> bool:
        """Whether it is known to be a single point."""
        return not self.tableau.nonbasic


def complementary_cells(
    tableau: Tableau | None, n: int, pairs: frozenset[int], most: int
) -> Iterator[ExactCell]:
    """Yield polyhedra of solutions that together hold all solutions in the cell of a tableau.

    `pairs` are those of which neither variable has been left out as zero. By convexity a cell consists of solutions
    iff of each pair one variable is zero all over it, which linear programmes decide.

    Raises
    ------
    IterationLimitError
        There are more than `most` cells.
    """
    stack = [(tableau, pairs)]
    for _ in range(most):
        if not stack:
            return
        cell, open_pairs = stack.pop()
        cell = None if cell is None else feasible(cell)
        if cell is None:
            continue
        positive = _possibly_positive(cell)
        i = next((i for i in open_pairs if i in positive and n + i in positive), None)
        if i is None:
            zeros = frozenset(v for v in range(2 * n) if v not in positive)
            for v in zeros & {*cell.basic, *cell.nonbasic}:
                narrowed = without(cell, v)
                assert narrowed is not None
                cell = narrowed
            yield ExactCell(cell, zeros)
        else:
            stack += [(without(cell, v), open_pairs - {i}) for v in (n + i, i)]
    if stack:
        raise IterationLimitError(f"the search in exact arithmetic met more than {most} complementary cells")


def _possibly_positive(cell: Tableau) -> set[int]:
    """Return the variables that are positive at some point of a feasible tableau."""
    positive = {v for v, row in zip(cell.basic, cell.rows, strict=True) if row[-1] > 0}
    others = [v for v in (*cell.basic, *cell.nonbasic) if v not in positive] if cell.nonbasic else []
    return positive | {v for v in others if can_increase(cell, {v: fmpz(1)})}


def without(tableau: Tableau | None, variable: int) -> Tableau | None:
    """Return the tableau in which a variable is zero and gone, or None where the equations forbid it."""
    if tableau is None:
        return None
    if variable in tableau.nonbasic:
        return tableau.without_column(tableau.nonbasic.index(variable))
    return with_zero_basics(tableau, frozenset({variable}))


def exact_horizontal(M: Matrix, N: Matrix, q: Vector) -> ExactProblem | None:
    """Return M w = N z + q in whole numbers, or None where the equations have no solution of any sign.

    Examples
    --------
    >>> exact_horizontal(np.zeros((1, 1)), np.zeros((1, 1)), np.ones(1)) is None
    True
    """
    n = q.size
    table = np.hstack([M, -N])
    rows = []
    for left, right in zip(table.tolist(), q.tolist(), strict=True):
        rows.append(whole_numbers([*left, right], [0] * (2 * n + 1))[0])
    # Each equation has an artificial variable, which is zero.
    first = Tableau(fmpz(1), rows, tuple(range(2 * n, 3 * n)), tuple(range(2 * n)))
    tableau = with_zero_basics(first, frozenset(range(2 * n, 3 * n)))
    return None if tableau is None else ExactProblem(tableau, (0,) * (2 * n))


def with_basis(tableau: Tableau, basis: frozenset[int]) -> Tableau | None:
    """Return the tableau with these basic variables, or None where their columns are dependent."""
    for variable in sorted(basis - set(tableau.basic)):
        c = tableau.nonbasic.index(variable)
        rows = (r for r, row in enumerate(tableau.rows) if row[c] and tableau.basic[r] not in basis)
        r = next(rows, None)
        if r is None:
            return None
        tableau = tableau.pivot(r, c)
    return tableau if len(tableau.basic) == len(basis) else None
