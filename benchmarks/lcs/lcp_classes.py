"""Random linear complementarity problems by class, each with what is known of its solutions."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Matrix, Vector


class Posed(NamedTuple):
    """M and q of an LCP, and whether it is known to have a solution; None where it is not known."""

    M: Matrix  # (n, n)
    q: Vector  # (n,)
    is_solvable: bool | None


def block_on_plane(random: np.random.Generator, contacts: int) -> Posed:
    """Return one step of a rigid block in the plane that touches the ground at several points of its base.

    Coulomb friction as Stewart and Trinkle 1996 write it: M = [[N'N, N'D, 0], [D'N, D'D, E], [mu, -E', 0]] with the
    inverse mass between the factors. Solvable, with impulses that are not unique from three contacts on.
    """
    places = np.linspace(-1.0, 1.0, contacts)
    normals = np.column_stack([np.zeros(contacts), np.ones(contacts), places])
    along = np.column_stack([np.ones(contacts), np.zeros(contacts), np.full(contacts, 0.5)])
    inertia = np.diag([1.0, 1.0, random.uniform(0.2, 1.0)])
    return _with_friction(random, inertia, normals, along[:, None])


def box_on_plane(random: np.random.Generator, side: int) -> Posed:
    """Return one step of a box in space on a grid of side x side contacts, with a friction pyramid of four edges."""
    places = np.linspace(-1.0, 1.0, side)
    corners = np.array([(a, b, -0.5) for a in places for b in places])
    arm = np.zeros((len(corners), 3, 6))
    for k, (a, b, c) in enumerate(corners):
        turn = np.array([[0.0, c, -b], [-c, 0.0, a], [b, -a, 0.0]])
        arm[k] = np.hstack([np.eye(3), turn])
    inertia = np.diag(np.append(np.ones(3), random.uniform(0.2, 1.0, 3)))
    return _with_friction(random, inertia, arm[:, 2], arm[:, :2])


def _with_friction(random: np.random.Generator, inertia: Matrix, normals: Matrix, tangents: Matrix) -> Posed:
    """Return the problem of Stewart and Trinkle; normals (k, d), tangents (k, t, d), each taken in both directions."""
    k, d = normals.shape
    along = np.concatenate([tangents, -tangents], axis=1).reshape(-1, d)
    edges = len(along) // k
    E = np.kron(np.eye(k), np.ones((edges, 1)))
    J = np.vstack([normals, along])
    W = J @ np.linalg.solve(inertia, J.T)
    friction = np.diag(np.full(k, round(random.uniform(0.1, 1.0), 2)))
    M = np.zeros((len(J) + k, len(J) + k))
    M[: len(J), : len(J)] = W
    M[k : len(J), len(J) :] = E
    M[len(J) :, :k] = friction
    M[len(J) :, k : len(J)] = -E.T
    velocity = np.where(random.random(d) < 0.7, random.normal(size=d), 0.0)
    velocity[d // 3 if d == 3 else 2] -= 0.1  # gravity acts on it
    return Posed(M, np.append(J @ velocity, np.zeros(k)), True)


def rank_deficient(random: np.random.Generator, n: int) -> Posed:
    """Return contacts without friction, M = J J' of rank about n/2 and q = J v: solvable, z not unique."""
    J = random.normal(size=(n, max(1, n // 2)))
    return Posed(J @ J.T, J @ random.normal(size=J.shape[1]), True)


def skew_plus_diagonal(random: np.random.Generator, n: int) -> Posed:
    """Return M = S - S' + a diagonal that is zero in half its places, and q with a solution chosen first."""
    S = random.normal(size=(n, n))
    M = S - S.T + np.diag(np.where(random.random(n) < 0.5, 0.0, random.uniform(0.1, 1.0, n)))
    return Posed(M, _complementary(random, M), True)


def positive_definite(random: np.random.Generator, n: int) -> Posed:
    """Return M = A A' + a diagonal + a skew part: one solution."""
    A, S = random.normal(size=(2, n, n)) / np.sqrt(n)
    return Posed(A @ A.T + 0.1 * np.eye(n) + S - S.T, random.normal(size=n), True)


def opposite_rows(random: np.random.Generator, n: int) -> Posed:
    """Return two rows of opposite sign, [[-a, 1], [a, -1]] or [[-1, a], [1, -a]], q = (1, -1): solvable, n is 2."""
    a = round(10.0 ** random.uniform(-3.0, 3.0), 3)
    M = np.array([[-a, 1.0], [a, -1.0]] if random.random() < 0.5 else [[-1.0, a], [1.0, -a]])
    return Posed(M, np.array([1.0, -1.0]), True)


def small_integers(random: np.random.Generator, n: int) -> Posed:
    """Return whole numbers from -3 to 3: with one solution, many or none."""
    return Posed(random.integers(-3, 4, (n, n)).astype(float), random.integers(-3, 4, n).astype(float), None)


def _complementary(random: np.random.Generator, M: Matrix) -> Vector:
    kind = random.random(len(M))
    z = np.where(kind < 0.4, random.uniform(0.5, 2.0, len(M)), 0.0)
    return np.where(kind > 0.6, random.uniform(0.5, 2.0, len(M)), 0.0) - M @ z


class ProblemClass(NamedTuple):
    """A class of problems, by size: `make` takes a generator and one of the sizes."""

    make: Callable[[np.random.Generator, int], Posed]
    sizes: tuple[int, ...]


CLASSES = {
    "block in the plane, contacts": ProblemClass(block_on_plane, (2, 4, 6, 8, 12, 20, 30, 40)),
    "box in space, contacts along a side": ProblemClass(box_on_plane, (2, 3, 4)),
    "rank-deficient Delassus matrix": ProblemClass(rank_deficient, (2, 5, 10, 20, 50, 100, 200)),
    "skew plus diagonal": ProblemClass(skew_plus_diagonal, (2, 5, 10, 20, 50, 100, 200)),
    "positive definite": ProblemClass(positive_definite, (2, 5, 10, 50, 100, 200)),
    "opposite rows": ProblemClass(opposite_rows, (2,)),
    "small integers": ProblemClass(small_integers, (2, 3, 4, 6, 8)),
}


def members(name: str, size: int, count: int) -> Iterator[Posed]:
    """Yield so many problems of a class and size, the same in every run."""
    for seed in range(count):
        yield CLASSES[name].make(np.random.default_rng([seed, size]), size)
