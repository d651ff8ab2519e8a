"""Named max-plus matrices with what the literature says of them; brute force over simple circuits."""

from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations

import numpy as np
from hypothesis import strategies as st

E = -np.inf


@dataclass(frozen=True)
class KnownMatrix:
    """A matrix and its spectrum; None where the source does not say."""

    name: str
    source: str
    A: tuple[tuple[float, ...], ...]
    eigenvalue: Fraction
    cyclicity: int | None = None
    transient: int | None = None
    eigenvector: tuple[Fraction | int, ...] | None = None
    orbit: tuple[tuple[float, ...], ...] = ()

    def __str__(self) -> str:
        return self.name


BACCELLI = "Baccelli, Cohen, Olsder, Quadrat 1992; test_howard.jl of MaxPlus.jl"
HEIDERGOTT = "Heidergott, Olsder, van der Woude 2006, chapter 0"
CMLIB = "Geilen et al., cmlib"

KNOWN = (
    KnownMatrix(
        "two machines",
        BACCELLI,
        ((3, 7), (2, 4)),
        Fraction(9, 2),
        2,
        2,
        (Fraction(5, 2), 0),
        ((1, 0), (7, 4), (11, 9), (16, 13), (20, 18), (25, 22)),
    ),
    KnownMatrix(
        "one machine without its loop",
        BACCELLI,
        ((3, 7), (2, E)),
        Fraction(9, 2),
        eigenvector=(Fraction(9, 2), 2),
    ),
    KnownMatrix(
        "railway",
        HEIDERGOTT,
        ((2, 5), (3, 3)),
        Fraction(4),
        2,
        2,
        (1, 0),
        ((0, 0), (5, 3), (8, 8), (13, 11), (16, 16)),
    ),
    KnownMatrix(
        "Dutch railroad",
        f"{CMLIB}, sdf_railroad",
        ((E, 1, 3, E), (1, E, E, E), (4, E, E, 4), (4, E, E, 4)),
        Fraction(4),
        1,
        4,
        None,
        ((0, 0, 0, 0), (3, 1, 4, 4), (7, 4, 8, 8), (11, 8, 12, 12)),
    ),
    KnownMatrix(
        "producer and consumer",
        f"{CMLIB}, mpm_prod_cons",
        (
            (2, 2, E, E, E, E),
            (E, E, 0, E, E, E),
            (5, 5, E, 3, E, E),
            (E, E, E, E, 0, E),
            (6, 6, E, 4, E, 1),
            (6, 6, E, 4, E, 1),
        ),
        Fraction(5, 2),
        2,
        6,
        (-4, Fraction(-7, 2), -1, Fraction(-5, 2), 0, 0),
    ),
)


def simple_circuits(A):
    """Return all (weight, nodes) of simple circuits, by trying every order of every set of nodes: n <= 6."""
    n, found = len(A), []
    for length in range(1, n + 1):
        for nodes in permutations(range(n), length):
            if nodes[0] == min(nodes):
                steps = zip(nodes, nodes[1:] + nodes[:1], strict=True)
                weights = [A[head][tail] for tail, head in steps]
                if E not in weights:
                    found.append((sum(weights), nodes))
    return found


@st.composite
def whole_matrices(draw, most=5, density=0.6, rows=None, columns=None):
    """Draw a matrix of whole numbers and epsilon, as floats."""
    n = rows or draw(st.integers(1, most))
    m = columns or (n if rows is None else rows)
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    share = draw(st.sampled_from([0.3, density, 1.0]))
    return np.where(random.random((n, m)) < share, random.integers(-6, 7, (n, m)), E)
