"""How the time for a large complementarity problem grows: sparse ones by kind and order, dense ones by order."""

import resource
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from math import isqrt
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array, eye_array, triu

from benchmarks.lcs.lcp_classes import CLASSES
from benchmarks.lcs.solver_table import by_siconos
from benchmarks.problems.complementarity_sets import SetProblem
from benchmarks.problems.sparse_complementarity import PROBLEMS
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp import LCP, MixedLCP, natural_residual, solve, solve_policy_iteration

ROOTS: dict[str, Callable[[int], int]] = {
    "obstacle in space": lambda n: round(n ** (1 / 3)),
    "elastic contact": lambda n: round((n / 2) ** 0.5),
    "tridiagonal": lambda n: n,
}
BESIDE_PEERS = ("obstacle", "tridiagonal")
DEGENERATE_CLASSES = ("rank-deficient Delassus matrix", "skew plus diagonal", "block in the plane, contacts")
UNKNOWNS_PER_SIZE = {"block in the plane, contacts": 4}  # of a class whose size is not its number of unknowns


def _square_root(n: int) -> int:
    return isqrt(n)


PATIENCE = 120.0  # seconds
LARGEST_PEER = 50_000  # unknowns: larger ones take the peers minutes
LARGEST_SICONOS = 1000  # unknowns: its matrices are dense
LARGEST = {"elastic contact": 400_000}  # unknowns: a million take a minute


class LargeRun(NamedTuple):
    """One solver on one problem: seconds of the processor, the natural residual relative to max |q|."""

    problem: str
    solver: str
    unknowns: int
    seconds: float | None
    residual: float | None
    iterations: int | None
    memory: float | None  # GB, the largest that the process has used so far

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return self.seconds is not None


def sparse_runs(orders: Sequence[int], names: Collection[str] = PROBLEMS.keys()) -> Iterator[LargeRun]:
    """Solve the kinds of sparse problems at every order, two kinds by peers as well."""
    for order in orders:
        for name, make in PROBLEMS.items():
            if name not in names or order > LARGEST.get(name, order):
                continue
            problem = make(ROOTS.get(name, _square_root)(order))
            yield _timed(name, "solve", problem, _by_us)
            if name in BESIDE_PEERS and order <= LARGEST_PEER:
                yield _timed(name, "policy iteration, SuperLU", problem, _by_policies)
                yield _timed(name, "Clarabel", problem, _by_clarabel)
                if order <= LARGEST_SICONOS:
                    yield from _by_lemke_of_siconos(name, problem)


def dense_runs(
    orders: Sequence[int], lemke_up_to: int, classes: Sequence[str] = ("positive definite",)
) -> Iterator[LargeRun]:
    """Solve random dense problems by `solve`, by its Lemke method and by Siconos' Lemke method."""
    for name in classes:
        for order in orders:
            size = max(2, order // UNKNOWNS_PER_SIZE.get(name, 1))
            posed = CLASSES[name].make(np.random.default_rng(order), size)
            problem = LCP(posed.M, posed.q)
            yield _timed(name, "solve", problem, _by_us)
            if order <= lemke_up_to:
                yield _timed(name, "Lemke", problem, lambda given: (solve(given, method="lemke").z, None))
                yield from _by_lemke_of_siconos(name, problem)


def _by_lemke_of_siconos(name: str, problem: LCP | MixedLCP) -> Iterator[LargeRun]:
    for cell in by_siconos("", [SetProblem("", "", problem, True)], "LEMKE"):
        right = cell.verdict == "solved" and cell.milliseconds is not None
        seconds = 1e-3 * cell.milliseconds if right and cell.milliseconds is not None else None
        yield LargeRun(name, "Siconos, Lemke", problem.size, seconds, cell.residual, cell.pivots, None)


def _timed(
    name: str,
    solver: str,
    problem: LCP | MixedLCP,
    answer: Callable[[LCP | MixedLCP], tuple[Vector, int | None]],
) -> LargeRun:
    begin = time.process_time()  # a busy machine changes it little
    try:
        z, iterations = answer(problem)
    except NumericalError:
        return LargeRun(name, solver, problem.size, None, None, None, None)
    seconds = time.process_time() - begin
    residual = natural_residual(problem, z) / float(np.abs(problem.q).max())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return LargeRun(name, solver, problem.size, seconds, residual, iterations, memory)


def _by_us(problem: LCP | MixedLCP) -> tuple[Vector, int | None]:
    found = solve(problem, time_limit=PATIENCE)
    return found.z, found.iterations


def _by_policies(problem: LCP | MixedLCP) -> tuple[Vector, int | None]:
    assert isinstance(problem, LCP)
    found = solve_policy_iteration(problem, time_limit=PATIENCE)
    return found.z, found.iterations


def _by_clarabel(problem: LCP | MixedLCP) -> tuple[Vector, int | None]:
    """Return the answer of an interior-point method to the quadratic programme, moved to z >= 0."""
    import clarabel  # noqa: PLC0415

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    n = problem.size
    upper: csc_array = triu(csr_array(problem.M)).tocsc()  # type: ignore[arg-type]
    below = -eye_array(n, format="csc")
    cones = [clarabel.NonnegativeConeT(n)]
    found = clarabel.DefaultSolver(upper, problem.q, below, np.zeros(n), cones, settings).solve()
    return np.maximum(np.array(found.x), 0.0), int(found.iterations)
