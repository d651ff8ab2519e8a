"""Every solution of a small LCP: isolated points, and the faces on which solutions form a continuum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector, as_whole_number, check_type
from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcp.basis import basic_point
from pricing_core.lcp.exact import (
    LARGEST_SEARCHED_ORDER,
    complementary_cells,
    exact_problem,
    rounded,
    without,
)
from pricing_core.lcp.linear_programme import minimise
from pricing_core.lcp.polyhedron import Face, face_of
from pricing_core.lcp.problem import LCP, LCPSolution, scaled_parts, scaled_residual, solution_of
from pricing_core.lcp.scaling import ScaledProblem, equilibrate
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.linalg.polynomial_tableau import Tableau

LARGEST_ORDER = LARGEST_SEARCHED_ORDER
MOST_EXACT_CELLS = 2000  # in exact arithmetic for each cell of the search, a millisecond each
WORK = "enumeration"
POLISHED = 1e-13  # scaled residual of a basic point that is a solution
ZERO = 1e-8  # in the scaled problem, whose largest |q| is 1: less than this counts as zero


@dataclass(frozen=True, slots=True, eq=False)
class SolutionSet:
    """The set of all solutions of an LCP.

    Parameters
    ----------
    isolated : tuple of LCPSolution
        The solutions that lie on no face, each once, ordered by their components.
    faces : tuple of Face
        The maximal polyhedra of solutions of dimension 1 or more; two of them may share vertices. A Face is
        the pair (vertices, rays) of arrays of shape (k, n) and (m, n).
    nodes : int
        Linear programmes solved in the search.
    complete : bool
        True: proved that every solution of the problem as it is given lies in what was found, to within 1e-8 of the
        scaled problem. False: a continuum was met of which only a part is described.
    """

    isolated: tuple[LCPSolution, ...]
    faces: tuple[Face, ...]
    nodes: int
    complete: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Cell:
    """The polyhedron {z >= 0, M z + q >= 0, z_i = 0 where zero_z, w_i = 0 where zero_w}."""

    zero_z: BoolVector  # (n,)
    zero_w: BoolVector  # (n,)

    def with_zero_z(self, i: int) -> _Cell:
        zero_z = self.zero_z.copy()
        zero_z[i] = True
        return _Cell(zero_z, self.zero_w)

    def with_zero_w(self, i: int) -> _Cell:
        zero_w = self.zero_w.copy()
        zero_w[i] = True
        return _Cell(self.zero_z, zero_w)


def enumerate_solutions(
    problem: LCP, *, max_nodes: int = 200_000, time_limit: float | None = None
) -> SolutionSet:
    """Find all solutions of an LCP with n <= 20, singular principal submatrices included.

    The solutions are the faces of {z >= 0, M z + q >= 0} on which z_i w_i = 0 for every i. A depth-first
    search splits on z_i = 0 or w_i = 0. The linear programme max sum_i min(z_i, w_i, 1) drops the empty
    cells, names the index to split on, and stops where its value is 0: then by convexity the whole cell
    consists of solutions.

    Parameters
    ----------
    problem : LCP
        n <= 20.
    max_nodes : int, optional
        Limit on linear programmes, 1 to 2 ms each. A few hundred are usual at n = 20 with a single solution;
        a problem with 2**n - 1 solutions needs twice as many.
    time_limit : float, optional
        Seconds after which the search ends.

    Returns
    -------
    SolutionSet

    Raises
    ------
    InvalidInputError
        n > 20.
    IterationLimitError
        `max_nodes` or `time_limit` were not enough.

    Notes
    -----
    Decisions are made in the equilibrated problem, whose largest |q| is 1: numbers below 1e-8 are zero there,
    so that solutions closer than that are one, and a solution must have a scaled residual below 1e-8. So the solutions
    of data that were rounded are found as those of the data before.

    A cell that the linear programmes leave out is searched again in exact arithmetic, for the numbers as they are
    given. What it holds joins the isolated solutions, or it is proved to be empty. `complete` is False only where the
    exact search met a continuum or came to its limit of 2 000 cells.

    Examples
    --------
    >>> found = enumerate_solutions(LCP([[1.0, 2.0], [2.0, 1.0]], [-3.0, -3.0]))
    >>> [solution.z.round(12).tolist() for solution in found.isolated], found.faces
    ([[0.0, 3.0], [1.0, 1.0], [3.0, 0.0]], ())
    >>> enumerate_solutions(LCP([[1.0, -1.0], [-1.0, 1.0]], [1.0, -1.0])).faces
    (Face(vertices=array([[0., 1.]]), rays=array([[1., 1.]])),)
    """
    check_type("problem", problem, LCP)
    n = problem.size
    if n > LARGEST_ORDER:
        raise InvalidInputError(
            "M", f"a matrix of order {n}", f"of order at most {LARGEST_ORDER} for enumeration"
        )
    if n == 0:
        return SolutionSet((solution_of(problem, np.zeros(0), 0, "enumeration"),), (), 0, True)
    max_nodes, limit = as_whole_number("max_nodes", max_nodes, 1), TimeLimit(time_limit)
    scaled = equilibrate(problem)
    cells, dropped, nodes = _solution_cells(scaled.M, scaled.q, max_nodes, limit)
    narrowed = [_with_implied_zeros(scaled.M, scaled.q, cell, point) for cell, point in cells]
    described = [(cell, *_checked_face(scaled, cell)) for cell in narrowed]
    maximal = _maximal(scaled, [(cell, face) for cell, face, _ in described])
    isolated = [_isolated(problem, scaled, face.vertices[0], nodes) for face in maximal if face.is_point]
    faces = [
        Face(scaled.original(f.vertices), scaled.original_ray(f.rays)) for f in maximal if not f.is_point
    ]
    missed, complete = _missed(problem, scaled, [*(cell for cell, _ in cells), *dropped], described, limit)
    isolated += [solution_of(problem, z, nodes, "enumeration") for z in missed]
    isolated.sort(key=lambda solution: solution.z.tolist())
    return SolutionSet(tuple(isolated), tuple(faces), nodes, complete)


def _missed(
    problem: LCP,
    scaled: ScaledProblem,
    cells: list[_Cell],
    described: list[tuple[_Cell, Face, bool]],
    limit: TimeLimit,
) -> tuple[list[Vector], bool]:
    """Search cells in exact arithmetic; return solutions that no described face holds, and whether these are all."""
    posed, n = exact_problem(problem), problem.size
    whole = [cell for cell, _, is_whole in described if is_whole]
    proved = [np.flatnonzero(np.append(cell.zero_w, cell.zero_z)) for cell in whole]
    found: dict[tuple[float, ...], Vector] = {}
    complete = True
    for cell in cells:
        limit.check(WORK)
        tableau: Tableau | None = posed.tableau
        for v in (*np.flatnonzero(cell.zero_w).tolist(), *(n + np.flatnonzero(cell.zero_z)).tolist()):
            tableau = without(tableau, v)
        pairs = frozenset(np.flatnonzero(~(cell.zero_z | cell.zero_w)).tolist())
        try:
            for exact in complementary_cells(tableau, n, pairs, MOST_EXACT_CELLS):
                limit.check(WORK)
                if any(exact.zeros.issuperset(zeros.tolist()) for zeros in proved):
                    continue
                z = rounded(posed.values(exact.tableau)[n:])
                if not any(_holds(problem, z, other) for other in whole):
                    found[tuple(z.tolist())] = z
                complete &= exact.is_point
        except IterationLimitError:
            limit.check(WORK)
            complete = False
    return list(found.values()), complete


def _holds(problem: LCP, z: Vector, cell: _Cell) -> bool:
    """Tell whether the zeros of a cell are zero at a solution, to within 1e-8 of the terms of each row."""
    weight, slack = scaled_parts(problem, z)
    return not ((weight * cell.zero_z > ZERO) | (slack * cell.zero_w > ZERO)).any()


def _solution_cells(
    M: Matrix, q: Vector, max_nodes: int, limit: TimeLimit
) -> tuple[list[tuple[_Cell, Vector]], list[_Cell], int]:
    """Return cells that consist of solutions, those that were left out as empty, and the number of cells."""
    nowhere = np.zeros(q.size, dtype=np.bool_)
    stack, found, dropped, nodes = [_Cell(nowhere, nowhere)], [], [], 0
    while stack:
        if nodes >= max_nodes:
            raise IterationLimitError(
                f"enumeration needs more than {max_nodes} linear programmes: raise max_nodes"
            )
        limit.check(WORK)
        cell = stack.pop()
        nodes += 1
        try:
            point = _least_complementary_point(M, q, cell)
        except NumericalError:
            point = None
        if point is None:
            dropped.append(cell)
            continue
        overlap = np.where(cell.zero_z | cell.zero_w, 0.0, np.minimum(point, M @ point + q))
        i = int(np.argmax(overlap))
        if overlap[i] <= ZERO:
            found.append((cell, point))
        else:
            stack += [cell.with_zero_z(i), cell.with_zero_w(i)]
    return found, dropped, nodes


def _least_complementary_point(M: Matrix, q: Vector, cell: _Cell) -> Vector | None:
    """Return the point of the cell that maximises sum_i min(z_i, w_i, 1), or None where the cell is empty."""
    n = q.size
    identity, zero = np.eye(n), np.zeros((n, n))
    rows = np.block([[-M, zero], [-identity, identity], [-M, identity]])  # w >= 0, t <= z, t <= w
    sizes = np.concatenate([q, np.zeros(n), q])
    caps = np.where(cell.zero_z | cell.zero_w, 0.0, 1.0)
    point = _maximise(np.concatenate([np.zeros(n), np.ones(n)]), rows, sizes, M, q, cell, caps)
    return None if point is None else point[:n]


def _with_implied_zeros(M: Matrix, q: Vector, cell: _Cell, point: Vector) -> _Cell:
    """Add to a cell of solutions every z_i = 0 or w_i = 0 that holds all over it."""
    w = M @ point + q
    for i in np.flatnonzero(~(cell.zero_z | cell.zero_w)).tolist():
        # Where z_i or w_i is positive somewhere, the other one is zero everywhere.
        if point[i] > ZERO or _largest(M, q, cell, np.eye(q.size)[i], 0.0) > ZERO:
            cell = cell.with_zero_w(i)
        elif w[i] > ZERO or _largest(M, q, cell, M[i], float(q[i])) > ZERO:
            cell = cell.with_zero_z(i)
        else:
            cell = cell.with_zero_z(i).with_zero_w(i)
    return cell


def _largest(M: Matrix, q: Vector, cell: _Cell, gradient: Vector, offset: float) -> float:
    """Return the maximum of min(gradient z + offset, 1) on a cell where some point has it at most 1."""
    rows, sizes = np.vstack([-M, gradient]), np.append(q, 1.0 - offset)
    point = _maximise(gradient, rows, sizes, M, q, cell, np.zeros(0))
    return 0.0 if point is None else float(gradient @ point) + offset


def _maximise(
    gain: Vector, rows: Matrix, sizes: Vector, M: Matrix, q: Vector, cell: _Cell, caps: Vector
) -> Vector | None:
    """Maximise gain x over x = (z, t) with rows x <= sizes, z in the cell, 0 <= t <= caps; None if empty."""
    equations = np.hstack([M[cell.zero_w], np.zeros((int(cell.zero_w.sum()), caps.size))])
    highest = np.concatenate([np.where(cell.zero_z, 0.0, np.inf), caps])
    return minimise(-gain, rows, sizes, highest, equations=equations, values=-q[cell.zero_w])


def _checked_face(scaled: ScaledProblem, cell: _Cell) -> tuple[Face, bool]:
    """Return the vertices and rays of a cell, without vertices that fail as solutions, and whether none failed."""
    face = face_of(scaled.M, scaled.q, cell.zero_z, cell.zero_w)
    problem = LCP(scaled.M, scaled.q)
    good = np.array([scaled_residual(problem, vertex) <= ZERO for vertex in face.vertices], dtype=np.bool_)
    return Face(face.vertices[good], face.rays), bool(good.size and good.all())


def _maximal(scaled: ScaledProblem, found: list[tuple[_Cell, Face]]) -> list[Face]:
    """Return the faces that lie in no other one, each once."""
    kept: list[tuple[_Cell, Face]] = []
    by_size = sorted(found, key=lambda pair: len(pair[1].vertices) + len(pair[1].rays), reverse=True)
    for cell, face in by_size:
        if len(face.vertices) and not any(_lies_in(scaled, face, other) for other, _ in kept):
            kept.append((cell, face))
    faces = [face for _, face in kept]
    # A face with few generators may still contain one with more.
    return [
        face
        for k, face in enumerate(faces)
        if not any(_lies_in(scaled, face, other) for other, _ in kept[:k] + kept[k + 1 :])
    ]


def _lies_in(scaled: ScaledProblem, face: Face, cell: _Cell) -> bool:
    z = np.concatenate([face.vertices, face.rays])
    slack = z @ scaled.M.T
    slack[: len(face.vertices)] += scaled.q
    close = ZERO * (1.0 + np.max(np.abs(z), axis=1, keepdims=True))
    outside = (z * cell.zero_z > close) | (slack * cell.zero_w > close)
    return not outside.any()


def _isolated(problem: LCP, scaled: ScaledProblem, vertex: Vector, nodes: int) -> LCPSolution:
    """Return the solution at a vertex, polished by the linear system of its positive components."""
    rough = scaled.original(vertex)
    try:
        polished = np.maximum(basic_point(problem, vertex > ZERO), 0.0)
    except NumericalError:
        polished = rough
    z = polished if scaled_residual(problem, polished) <= POLISHED else rough
    return solution_of(problem, z, nodes, "enumeration")
