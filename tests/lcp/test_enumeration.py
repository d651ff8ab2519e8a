"""Enumeration against a brute force over all complementary cones."""

from itertools import combinations, product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcp import LCP, Face, SolutionSet, enumerate_solutions, natural_residual
from tests.problems.lcp_problems import fathi

seeds = st.integers(0, 2**32 - 1)


def points_of_all_cells(M: Matrix, q: Vector, directions: Matrix) -> list[Vector]:
    """Return, for every choice of z_i = 0 or w_i = 0, extreme points of that cell in several directions."""
    found = []
    for choice in product((False, True), repeat=len(q)):
        basic = np.array(choice)
        bounds = [(0.0, 10.0 if b else 0.0) for b in basic]
        for direction in directions:
            cell = linprog(
                direction, A_ub=-M, b_ub=q, A_eq=M[basic], b_eq=-q[basic], bounds=bounds, method="highs"
            )
            if cell.status == 0:
                found.append(cell.x)
    return found


def lies_in(face: Face, z: Vector) -> bool:
    """Tell whether z is a convex combination of the vertices plus a nonnegative one of the rays."""
    vertices = np.vstack([face.vertices.T, np.ones(len(face.vertices))])
    rays = np.vstack([face.rays.T, np.zeros(len(face.rays))])
    return bool(nnls(np.hstack([vertices, rays]), np.append(z, 1.0))[1] <= 1e-6)


def is_covered(found: SolutionSet, z: Vector) -> bool:
    at_point = any(np.allclose(z, solution.z, atol=1e-6) for solution in found.isolated)
    return at_point or any(lies_in(face, z) for face in found.faces)


@given(st.integers(1, 4), seeds)
@settings(max_examples=30, deadline=None)
def test_every_complementary_cell_is_covered_and_everything_found_is_a_solution(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    M = random.integers(-1, 2, (n, n)).astype(np.float64)
    q = random.integers(-1, 2, n).astype(np.float64)
    problem, found = LCP(M, q), enumerate_solutions(LCP(M, q))
    cells = points_of_all_cells(M, q, random.normal(size=(4, n)))
    assert all(is_covered(found, z) for z in cells)
    assert bool(cells) >= bool(found.isolated or found.faces)
    for face in found.faces:
        inner = face.vertices.mean(axis=0) + face.rays.sum(axis=0)
        assert len(face.vertices) + len(face.rays) >= 2
        assert natural_residual(problem, inner) <= 1e-9
    for solution in found.isolated:
        assert solution.residual <= 1e-9
        assert not any(lies_in(face, solution.z) for face in found.faces)


def test_all_2_to_the_n_minus_1_solutions_are_found() -> None:
    # w_i = z_i + 2 (sum of the others) - 1: on any support of size k, z = 1 / (2 k - 1).
    n = 6
    found = enumerate_solutions(LCP(2.0 * np.ones((n, n)) - np.eye(n), -np.ones(n)))
    assert found.faces == ()
    supports = {tuple(solution.z > 0.0) for solution in found.isolated}
    assert len(found.isolated) == len(supports) == 2**n - 1
    for solution in found.isolated:
        size = np.count_nonzero(solution.z)
        np.testing.assert_allclose(solution.z[solution.z > 0.0], 1.0 / (2 * size - 1), rtol=1e-12)


def test_a_simplex_of_solutions_is_one_face() -> None:
    n = 20
    (face,) = enumerate_solutions(LCP(np.ones((n, n)), -np.ones(n))).faces
    np.testing.assert_allclose(np.sort(face.vertices, axis=0), np.sort(np.eye(n), axis=0), atol=1e-12)
    assert face.vertices.shape == (n, n)
    assert face.rays.shape == (0, n)


def test_a_face_with_many_vertices_is_described_completely() -> None:
    # M = u u^T, so w = 0 on {z >= 0: u^T z = u^T z0}: a polytope of dimension 5 in 8 unknowns.
    random = np.random.default_rng(3)
    u, z0 = random.normal(size=(8, 3)), random.uniform(0.5, 1.0, 8)
    (face,) = enumerate_solutions(LCP(u @ u.T, -u @ u.T @ z0)).faces
    expected = []
    for support in combinations(range(8), 3):
        basic = np.linalg.solve(u[list(support)].T, u.T @ z0)
        if (basic > 0.0).all():
            expected.append(np.bincount(support, basic, 8))
    np.testing.assert_allclose(face.vertices, sorted(expected, key=list), atol=1e-9)


def test_twenty_unknowns_with_a_p_matrix_take_a_small_tree() -> None:
    n = 20
    found = enumerate_solutions(LCP(fathi(n), -np.ones(n)))
    assert len(found.isolated) == 1
    np.testing.assert_allclose(found.isolated[0].z, np.eye(n)[0], atol=1e-12)
    assert found.nodes < 1000
