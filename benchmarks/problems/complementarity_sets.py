"""Small complementarity problems of the literature and of others' tests, with what is known of their solutions."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.lcs.lcp_classes import block_on_plane, box_on_plane, rank_deficient
from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP, MixedLCP, ProblemFormat, read_problem

SICONOS = Path(__file__).parents[2] / "tests" / "data" / "siconos"
HANDBOOK = "Floudas et al. 1999, Handbook of test problems, section 10.2, as in the tests of Drake"


@dataclass(frozen=True, slots=True, eq=False)
class SetProblem:
    """A problem, where it comes from, and whether it has a solution, None where that is not known."""

    name: str
    source: str
    problem: LCP | MixedLCP
    is_solvable: bool | None


def murty(n: int) -> Matrix:
    """Return ones on the diagonal and twos above it: 2**n - 1 pivots for Murty's method with q = -1."""
    return np.eye(n) + np.triu(np.full((n, n), 2.0), 1)


def fathi(n: int) -> Matrix:
    """Return L L' with ones on the diagonal of L and twos below it: exponentially many pivots as well."""
    L = murty(n).T
    return np.asarray(L @ L.T)


def kojima_shindo(x: Vector) -> tuple[Vector, Matrix]:
    """Return F(x) and its Jacobian, shapes (4,) and (4, 4), of the problem of Kojima and Shindo 1986.

    The solutions of 0 <= x _|_ F(x) >= 0 are (1, 0, 3, 0) and (6**0.5 / 2, 0, 0, 1 / 2), where x_3 = F_3 = 0.
    """
    return _quadratic(
        x, np.array([[0.0, 1.0, 3.0], [1.0, 10.0, 2.0], [0.0, 2.0, 9.0], [0.0, 2.0, 3.0]]), (6, 2, 9, 3)
    )


def josephy(x: Vector) -> tuple[Vector, Matrix]:
    """Return F(x) and its Jacobian of Josephy's problem of 1979, whose solution is (6**0.5 / 2, 0, 0, 1 / 2)."""
    return _quadratic(
        x, np.array([[0.0, 1.0, 3.0], [1.0, 3.0, 2.0], [0.0, 2.0, 3.0], [0.0, 2.0, 3.0]]), (6, 2, 1, 3)
    )


def _quadratic(x: Vector, linear: Matrix, constant: tuple[int, ...]) -> tuple[Vector, Matrix]:
    a, b = x[0], x[1]
    squares = np.array([[3.0, 2.0, 2.0], [2.0, 0.0, 1.0], [3.0, 1.0, 2.0], [1.0, 0.0, 3.0]])
    value = squares @ np.array([a * a, a * b, b * b]) + linear @ np.array([a, x[2], x[3]]) - constant
    jacobian = np.zeros((4, 4))
    jacobian[:, 0] = 2.0 * squares[:, 0] * a + squares[:, 1] * b + linear[:, 0]
    jacobian[:, 1] = squares[:, 1] * a + 2.0 * squares[:, 2] * b
    jacobian[:, 2:] = linear[:, 1:]
    return value, jacobian


def linearised(function: Callable[[Vector], tuple[Vector, Matrix]], x: Vector) -> LCP:
    """Return the LCP of a step of Josephy and Newton at x."""
    value, jacobian = function(x)
    return LCP(jacobian, value - jacobian @ x)


def bimatrix(n: int, seed: int) -> LCP:
    """Return the equilibria of a game with two players of n strategies each: solvable (Lemke and Howson 1964)."""
    costs = np.random.default_rng([n, seed]).uniform(1.0, 2.0, (2, n, n))
    M = np.block([[np.zeros((n, n)), costs[0]], [costs[1], np.zeros((n, n))]])
    return LCP(M, -np.ones(2 * n))


def copositive(n: int, seed: int) -> LCP:
    """Return a copositive M >= 0 of few whole numbers and a solution with w = z = 0 in many places."""
    random = np.random.default_rng([n, seed])
    M = np.where(random.random((n, n)) < 0.3, random.integers(0, 3, (n, n)), 0).astype(float)
    kind = random.random(n)
    z = np.where(kind < 0.3, random.integers(1, 3, n), 0.0)
    return LCP(M, np.where(kind > 0.7, random.integers(1, 3, n), 0.0) - M @ z)


def two_boxes_with_parallel_joints() -> MixedLCP:
    """Return two equal boxes held by parallel hinges that act twice, pushed against a stop between them.

    The joints are free multipliers whose matrix is singular, since each acts twice; the stop is one contact.
    """
    joints = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    J = np.vstack([joints, joints, [[1.0, 0.0, -1.0, 0.0]]])
    velocity = np.array([-1.0, -1.0, 1.0, 1.0])
    return MixedLCP(J @ J.T, J @ velocity, np.append(np.full(4, -np.inf), 0.0), np.inf)


def all_sets() -> Iterator[tuple[str, list[SetProblem]]]:
    """Yield the sets by name."""
    yield "handbook, as in the tests of Drake", _handbook()
    yield "exponential families", _exponential()
    yield "linearisations", _linearisations()
    yield (
        "games",
        [
            SetProblem(f"bimatrix game, {n} strategies", "Lemke and Howson 1964", bimatrix(n, 0), True)
            for n in (3, 10, 30)
        ],
    )
    yield (
        "degenerate copositive",
        [SetProblem(f"copositive, {n} unknowns", "made here", copositive(n, 1), True) for n in (6, 12, 25)],
    )
    yield "contact", _contact()
    yield "what others failed on", _failures()
    yield "Siconos", list(siconos())


def _handbook() -> list[SetProblem]:
    game = [[0, 0, 10, 20], [0, 0, 30, 15], [10, 20, 0, 0], [30, 15, 0, 0]]
    market = [[11, 0, 10, -1], [0, 11, 10, -1], [10, 10, 21, -1], [1, 1, 1, 0]]
    given: list[tuple[str, object, object, bool]] = [
        ("diagonal 1 to 9", np.diag(np.arange(1.0, 10.0)), -np.ones(9), True),
        ("10.2.1, n = 16", murty(16), -np.ones(16), True),
        ("10.2.2", np.ones((2, 2)), [-1, -1], True),
        ("10.2.3", [[0, -1, 2], [2, 0, -2], [-1, 1, 0]], [-3, 6, -1], True),
        ("10.2.4", game, [-1, -1, -1, -1], True),
        ("10.2.9, l = 1", market, [50, 50, 1, -6], True),
        ("10.2.9, l = 16", market, [50, 50, 16, -6], True),
        ("10.2.9, l = 100", market, [50, 50, 100, -6], True),
        ("no solution", [[-1]], [-1], False),
    ]
    return [SetProblem(name, HANDBOOK, LCP(M, q), known) for name, M, q, known in given]  # type: ignore[arg-type]


def _exponential() -> list[SetProblem]:
    families = (("Murty", "Murty 1978", murty), ("Fathi", "Fathi 1979", fathi))
    return [
        SetProblem(f"{name}, n = {n}", source, LCP(make(n), -np.ones(n)), True)
        for name, source, make in families
        for n in (8, 16, 32)
    ]


def _linearisations() -> list[SetProblem]:
    starts = {
        "0": np.zeros(4),
        "1": np.ones(4),
        "(1.25, 0, 0, .5)": np.array([1.25, 0.0, 0.0, 0.5]),
        "100": np.full(4, 100.0),
    }
    functions = (
        ("Kojima-Shindo", "Kojima and Shindo 1986", kojima_shindo),
        ("Josephy", "Josephy 1979", josephy),
    )
    return [
        SetProblem(f"{name} at {where}", source, linearised(function, x), None)
        for name, source, function in functions
        for where, x in starts.items()
    ]


def _contact() -> list[SetProblem]:
    random = np.random.default_rng(5)
    made = {
        "block, 4 contacts": block_on_plane(random, 4),
        "block, 12 contacts": block_on_plane(random, 12),
        "box, 9 contacts": box_on_plane(random, 3),
        "rank-deficient, 40 contacts": rank_deficient(random, 40),
    }
    source = "Stewart and Trinkle 1996"
    return [SetProblem(name, source, LCP(posed.M, posed.q), True) for name, posed in made.items()]


def _failures() -> list[SetProblem]:
    random = np.random.default_rng(0)
    A = random.normal(size=(10, 10))
    return [
        SetProblem(
            "A'A + I, n = 10",
            "QuantEcon's lcp_lemke gave z < 0",
            LCP(A.T @ A + np.eye(10), random.normal(size=10)),
            True,
        ),
        SetProblem(
            "two boxes, parallel joints",
            "DART's Dantzig solver gave NaN",
            two_boxes_with_parallel_joints(),
            True,
        ),
    ]


def siconos() -> Iterator[SetProblem]:
    """Yield the problems of Siconos' tests that are square."""
    for path in sorted(SICONOS.glob("*.dat")):
        kind: ProblemFormat = "siconos-relay"
        if path.name.startswith("lcp"):
            kind = "siconos-lcp"
        elif "mlcp" in path.name:
            kind = "siconos-mlcp"
        if not path.name.startswith("Rectangular"):
            known = "perturbed" not in path.name or "inf_sol" in path.name
            yield SetProblem(path.stem, "tests of Siconos", read_problem(path, kind), known)
