"""Named linear complementarity problems with all their solutions, and where they come from."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP
from pricing_core.linalg import Tridiagonal


@dataclass(frozen=True, slots=True, eq=False)
class KnownProblem:
    """w = M z + q with every solution z; `classes` names what is known of M."""

    name: str
    source: str
    M: ArrayLike | Tridiagonal
    q: ArrayLike
    isolated: tuple[tuple[float, ...], ...] = ()
    faces: tuple[tuple[ArrayLike, ArrayLike], ...] = ()  # (vertices, rays)
    classes: frozenset[str] = field(default=frozenset())

    @property
    def lcp(self) -> LCP:
        return LCP(self.M, self.q)

    @property
    def solution(self) -> Vector:
        """The solution, where there is exactly one."""
        assert len(self.isolated) == 1
        assert not self.faces
        return np.array(self.isolated[0])

    def __str__(self) -> str:
        return self.name


def murty_exponential(n: int) -> Matrix:
    """Return ones on the diagonal and twos above it."""
    return np.eye(n) + np.triu(np.full((n, n), 2.0), 1)


def fathi(n: int) -> Matrix:
    """Return L L^T with L = ones on the diagonal and twos below it: symmetric positive definite."""
    L = murty_exponential(n).T
    return L @ L.T


def string_over(z: tuple[float, ...], w: tuple[float, ...]) -> tuple[Tridiagonal, Vector]:
    """Return the stretched string tridiag(-1, 2, -1) and the q for which z and w are the solution."""
    n = len(z)
    M = Tridiagonal(-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1))
    return M, np.array(w) - M @ np.array(z)


def _string(name: str, z: tuple[float, ...], w: tuple[float, ...], *contact: str) -> KnownProblem:
    M, q = string_over(z, w)
    classes = frozenset({"P", "M", "H+", "positive definite", "symmetric", "tridiagonal", *contact})
    return KnownProblem(name, "complementary z and w chosen, q = w - M z", M, q, (z,), (), classes)


POSITIVE_DEFINITE = frozenset({"P", "positive definite", "symmetric"})

PROBLEMS = (
    KnownProblem(
        "murty 1",
        "Murty 1988, p. 2",
        [[2, 1], [1, 2]],
        (-5, -6),
        ((4 / 3, 7 / 3),),
        classes=POSITIVE_DEFINITE | {"H+"},
    ),
    KnownProblem(
        "segment",
        "Cottle, Pang, Stone 1992, example 4.1.14",
        np.ones((2, 2)),
        (-1, -1),
        faces=((((0, 1), (1, 0)), np.zeros((0, 2))),),
        classes=frozenset({"positive semidefinite"}),
    ),
    KnownProblem(
        "three pivots",
        "Cottle, Pang, Stone 1992, example 4.4.7",
        [[0, -1, 2], [2, 0, -2], [-1, 1, 0]],
        (-3, 6, -1),
        ((0, 1, 3),),
    ),
    KnownProblem(
        "bimatrix game",
        "Cottle, Pang, Stone 1992, example 4.4.23",
        [[0, 0, 10, 20], [0, 0, 30, 15], [10, 20, 0, 0], [30, 15, 0, 0]],
        (-1, -1, -1, -1),
        ((0, 1 / 15, 0, 1 / 15), (1 / 90, 2 / 45, 1 / 90, 2 / 45), (1 / 10, 0, 1 / 10, 0)),
        classes=frozenset({"ray"}),
    ),
    KnownProblem(
        "half line",
        "Cottle, Pang, Stone 1992, example 4.4.16",
        [[1, -1], [-1, 1]],
        (1, -1),
        faces=((((0, 1),), ((1, 1),)),),
        classes=frozenset({"positive semidefinite"}),
    ),
    KnownProblem(
        "murty exponential 6",
        "Murty 1978, Computational complexity of complementary pivot methods",
        murty_exponential(6),
        (-1,) * 6,
        ((0, 0, 0, 0, 0, 1),),
        classes=frozenset({"P", "H+"}),
    ),
    KnownProblem(
        "fathi 6",
        "Fathi 1979, Computational complexity of LCPs with positive definite symmetric matrices",
        fathi(6),
        (-1,) * 6,
        ((1, 0, 0, 0, 0, 0),),
        classes=POSITIVE_DEFINITE,
    ),
    KnownProblem(
        "kostreva 1",
        "Kostreva 1979, Cycling in linear complementarity problems",
        [[1, 2, 0], [0, 1, 2], [2, 0, 1]],
        (-1, -1, -1),
        ((1 / 3, 1 / 3, 1 / 3),),
        classes=frozenset({"P"}),
    ),
    KnownProblem(
        "murty 2.8",
        "Murty 1988, example 2.8",
        [[1, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]],
        (3, 5, -9, -5),
        ((2, 1, 3, 1),),
    ),
    KnownProblem(
        "three solutions",
        "w = 0 on each of {0}, {1}, {0, 1} in turn",
        [[1, 2], [2, 1]],
        (-1, -1),
        ((0, 1), (1 / 3, 1 / 3), (1, 0)),
    ),
    KnownProblem(
        "resting ball",
        "n = 1: w = z - 9.8",
        [[1]],
        (-9.8,),
        ((9.8,),),
        classes=POSITIVE_DEFINITE | {"M", "H+", "tridiagonal", "contact first", "contact last", "one run"},
    ),
    KnownProblem(
        "two edges",
        "n = 2: w = (0, 1 - z_0): z_0 <= 1, and z_1 > 0 only where z_0 = 1",
        [[0, 0], [-1, 0]],
        (0, 1),
        faces=((((0, 0), (1, 0)), np.zeros((0, 2))), (((1, 0),), ((0, 1),))),
    ),
    KnownProblem(
        "quadrant", "w = 0 everywhere", np.zeros((2, 2)), (0, 0), faces=((((0, 0),), ((0, 1), (1, 0))),)
    ),
    KnownProblem(
        "degenerate origin",
        "q = 0 and M positive definite: only z = 0, with w = 0",
        [[2, -1], [-1, 2]],
        (0, 0),
        ((0, 0),),
        classes=POSITIVE_DEFINITE | {"M", "H+", "tridiagonal", "contact first", "contact last", "one run"},
    ),
    _string("string, contact first", (0, 0, 1, 3), (2, 1, 0, 0), "contact first", "one run"),
    _string("string, contact last", (2, 1, 0, 0), (0, 0, 1, 3), "contact last", "one run"),
    _string("string, contact in the middle", (2, 1, 0, 0, 4), (0, 0, 3, 1, 0), "one run"),
    _string("string, two contacts", (0, 2, 0, 3, 1), (1, 0, 2, 0, 0)),
    _string("string, contact at both ends", (0, 2, 5, 0), (1, 0, 0, 2)),
    _string("string, no contact", (1, 2, 3), (0, 0, 0), "contact first", "contact last", "one run"),
    _string("string, all contact", (0, 0, 0), (1, 2, 1), "contact first", "contact last", "one run"),
    _string("string, degenerate contact", (0, 0, 0, 3), (2, 0, 0, 0), "contact first", "one run"),
)

INFEASIBLE = (
    KnownProblem("negative", "n = 1: w = -z - 1", [[-1]], (-1,)),
    KnownProblem("opposed rows", "w_0 + w_1 = -2 for every z", [[1, -1], [-1, 1]], (-1, -1)),
    KnownProblem("zero row", "w_1 = -1 for every z", [[1, 2], [0, 0]], (3, -1)),
)

# Feasible as inequalities, so that linear programming has nothing to prove, and yet without a solution.
NO_SOLUTION = (
    KnownProblem(
        "feasible, not solvable",
        "n = 2: w = (z_1 - 1, 1) is nonnegative for z_1 >= 1, but then z_1 w_1 > 0",
        [[0, 1], [0, 0]],
        (-1, 1),
    ),
)


def of_class(*classes: str) -> list[KnownProblem]:
    """Return the problems whose matrix is known to be in every one of the classes."""
    return [problem for problem in PROBLEMS if problem.classes.issuperset(classes)]
