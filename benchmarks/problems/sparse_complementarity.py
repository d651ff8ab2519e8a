"""Large sparse complementarity problems of mechanics, on a grid of any size."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array, eye_array, kron

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP, MixedLCP

YOUNG, POISSON = 1.0, 0.3


def _banded(bands: list[Vector], offsets: list[int]) -> csr_array:
    return csr_array(diags_array(bands, offsets=offsets))  # type: ignore[arg-type]


def laplacian(side: int) -> csr_array:
    """Return minus the five-point Laplacian on the unit square with zero boundary values, order side**2."""
    line = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    eye = eye_array(side)
    return csr_array((kron(line, eye) + kron(eye, line)) * float((side + 1) ** 2))


def points(side: int) -> tuple[Matrix, Matrix]:
    """Return the coordinates of the inner grid points of the unit square, each of shape (side, side)."""
    along = np.arange(1, side + 1) / (side + 1)
    return np.meshgrid(along, along, indexing="ij")


def obstacle(side: int) -> LCP:
    """Return a membrane, pressed down by a load of 4, over a wavy obstacle on a hill: z is the gap."""
    x, y = points(side)
    waves = 0.2 * np.sin(9 * np.pi * x) * np.sin(7 * np.pi * y)
    ground = (waves + 0.1 - 0.8 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)).ravel()
    M = laplacian(side)
    return LCP(M, M @ ground + 4.0)


def tridiagonal(n: int) -> LCP:
    """Return a string over a wavy ground, pressed down by a load of 10: a tridiagonal M-matrix of order n."""
    x = np.arange(1, n + 1) / (n + 1)
    ground = 0.1 * np.sin(9 * np.pi * x) - 0.5 * (x - 0.5) ** 2
    scale = float((n + 1) ** 2)
    M = _banded([np.full(n - 1, -scale), np.full(n, 2.0 * scale), np.full(n - 1, -scale)], [-1, 0, 1])
    return LCP(M, M @ ground + 10.0)


def pressed_obstacle(side: int) -> LCP:
    """Return the membrane under a load of 200, so that it touches more than half of the obstacle's crests."""
    x, y = points(side)
    ground = 0.05 * np.sin(9 * np.pi * x) * np.sin(7 * np.pi * y) - 0.05
    M = laplacian(side)
    return LCP(M, M @ ground.ravel() + 200.0)


def torsion(side: int) -> MixedLCP:
    """Return the elastic-plastic torsion of a square bar, twist 5: the stress function within the distance to the edge.

    Source: Glowinski 1984; Averick, Carter, Moré, Xue 1992, the MINPACK-2 test problem collection.
    """
    x, y = points(side)
    distance = np.minimum.reduce([x, 1.0 - x, y, 1.0 - y]).ravel()
    return MixedLCP(laplacian(side), np.full(side**2, -5.0), -distance, distance)


def journal_bearing(side: int) -> LCP:
    """Return the pressure in a journal bearing, eccentricity 0.1, on (0, 2 pi) x (0, 20).

    Source: Cimatti 1977; Averick, Carter, Moré, Xue 1992, the MINPACK-2 test problem collection.
    """
    hx, hy, eccentricity = 2.0 * np.pi / (side + 1), 20.0 / (side + 1), 0.1
    x = np.arange(1, side + 1) * hx

    def cubed(at: NDArray[np.floating]) -> Vector:
        return np.asarray((1.0 + eccentricity * np.cos(at)) ** 3, dtype=np.float64)

    left, right = cubed(x - 0.5 * hx), cubed(x + 0.5 * hx)
    along = _banded([-right[:-1], left + right, -right[:-1]], [-1, 0, 1]) / hx**2
    across = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side)) / hy**2
    M = kron(along, eye_array(side)) + kron(diags_array(cubed(x)), across)
    return LCP(csr_array(M), np.repeat(-eccentricity * np.sin(x), side))


def drifting_obstacle(side: int) -> LCP:
    """Return a stopping problem: a diffusion with a rotating drift, upwind, whose M-matrix is not symmetric."""
    x, y = points(side)
    step = 1.0 / (side + 1)
    M = laplacian(side)
    for drift, offset in (((y - 0.5).ravel(), side), ((0.5 - x).ravel(), 1)):
        back = np.maximum(200.0 * drift, 0.0) / step
        ahead = np.maximum(-200.0 * drift, 0.0) / step
        inner = np.ones(side**2)
        if offset == 1:
            inner[side - 1 :: side] = 0.0  # no link from the end of one line to the next
        links = inner[:-offset]
        M = M + _banded(
            [back + ahead, -ahead[:-offset] * links, -back[offset:] * links], [0, offset, -offset]
        )
    ground = 0.1 - (x - 0.5) ** 2 - (y - 0.4) ** 2
    return LCP(csr_array(M), csr_array(M) @ ground.ravel())


def obstacle_in_space(side: int) -> LCP:
    """Return the seven-point obstacle problem in the unit cube, order side**3."""
    line = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    eye = eye_array(side)
    M = kron(kron(line, eye), eye) + kron(kron(eye, line), eye) + kron(kron(eye, eye), line)
    along = np.arange(1, side + 1) / (side + 1)
    x, y, z = np.meshgrid(along, along, along, indexing="ij")
    ground = 0.2 - (x - 0.5) ** 2 - (y - 0.5) ** 2 - (z - 0.5) ** 2 + 0.05 * np.sin(12 * np.pi * x)
    scaled = csr_array(M * float((side + 1) ** 2))
    return LCP(scaled, np.asarray(scaled @ ground.ravel()) + 1.0)


def elastic_contact(side: int) -> MixedLCP:
    """Return an elastic square, plane strain, pressed on a wavy ground without friction (Signorini's problem).

    Bilinear elements; the top edge is moved down by 0.05, displacements are free but for those downwards at the bottom
    edge: order 2 side (side + 1). The matrix is symmetric positive definite, with positive entries off the diagonal.
    """
    element = _plane_strain()
    cells = np.arange(side**2)
    corner = cells // side * (side + 1) + cells % side  # nodes by columns, from the bottom to the top
    nodes = corner[:, None] + np.array([0, side + 1, side + 2, 1])
    unknowns = np.stack([2 * nodes, 2 * nodes + 1], axis=2).reshape(-1, 8)
    entries = np.broadcast_to(element, (side**2, 8, 8)).ravel()
    rows, columns = np.repeat(unknowns, 8, axis=1).ravel(), np.tile(unknowns, (1, 8)).ravel()
    total = 2 * (side + 1) ** 2
    K = csr_array(coo_array((entries, (rows, columns)), shape=(total, total)))
    height = np.arange((side + 1) ** 2) % (side + 1)
    fixed = np.repeat(height == side, 2)
    moved = np.where(fixed & (np.arange(total) % 2 == 1), -0.05, 0.0)
    free = np.flatnonzero(~fixed)
    lower = np.full((total // 2, 2), -np.inf)
    along = np.arange((side + 1) ** 2) // (side + 1) / side
    lower[height == 0, 1] = -0.04 * np.sin(3.0 * np.pi * along[height == 0]) ** 2
    return MixedLCP(K[free][:, free], (K @ moved)[free], lower.ravel()[free], np.inf)


def _plane_strain() -> Matrix:
    """Return the stiffness of a square bilinear element, corners counterclockwise, (8, 8); its size cancels."""
    factor = YOUNG / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
    law = factor * np.array(
        [[1.0 - POISSON, POISSON, 0.0], [POISSON, 1.0 - POISSON, 0.0], [0.0, 0.0, 0.5 - POISSON]]
    )
    K = np.zeros((8, 8))
    for a in (-(3**-0.5), 3**-0.5):
        for b in (-(3**-0.5), 3**-0.5):
            by_x = 0.5 * np.array([b - 1.0, 1.0 - b, 1.0 + b, -1.0 - b])
            by_y = 0.5 * np.array([a - 1.0, -1.0 - a, 1.0 + a, 1.0 - a])
            strain = np.zeros((3, 8))
            strain[0, ::2] = strain[2, 1::2] = by_x
            strain[1, 1::2] = strain[2, ::2] = by_y
            K += 0.25 * strain.T @ law @ strain
    return K


def h_plus(side: int) -> LCP:
    """Return random sparse rows with entries of either sign, weakly dominated by the diagonal; not symmetric."""
    n = side**2
    random = np.random.default_rng(n)
    rows, columns = np.repeat(np.arange(n), 6), random.integers(0, n, 6 * n)
    entries = random.normal(size=6 * n)
    off = csr_array(coo_array((entries, (rows, columns)), shape=(n, n)))
    off.setdiag(0.0)
    diagonal = 1.001 * np.asarray(abs(off).sum(axis=1)) + 1e-3
    return LCP(csr_array(off + diags_array(diagonal)), random.normal(size=n))


PROBLEMS: dict[str, Callable[[int], LCP | MixedLCP]] = {
    "obstacle": obstacle,
    "tridiagonal": tridiagonal,
    "pressed obstacle": pressed_obstacle,
    "torsion": torsion,
    "journal bearing": journal_bearing,
    "drifting obstacle": drifting_obstacle,
    "obstacle in space": obstacle_in_space,
    "elastic contact": elastic_contact,
    "H+": h_plus,
}
