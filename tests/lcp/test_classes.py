"""Degenerate and friction-type problems of every size: all that have a solution are solved."""

import numpy as np
import pytest

from benchmarks.lcs.lcp_classes import CLASSES, members
from pricing_core.errors import InfeasibleError
from pricing_core.lcp import LCP, scaled_residual, solve, solve_lemke
from tests.lcp.rational_reference import lcp_has_solution

SOLVABLE = [
    (name, size)
    for name, (_, sizes) in CLASSES.items()
    for size in sizes
    if name != "small integers" and size <= 100
]


@pytest.mark.parametrize(("name", "size"), SOLVABLE)
def test_every_member_is_solved(name: str, size: int) -> None:
    for posed in members(name, size, 15 if size <= 12 else 4):
        assert posed.is_solvable
        problem = LCP(posed.M, posed.q)
        found = solve(problem)
        assert (found.z >= 0.0).all()
        assert scaled_residual(problem, found.z) <= 1e-10


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name, (make, _) in CLASSES.items() if name != "small integers"])
def test_many_members_are_solved(name: str) -> None:
    for size in CLASSES[name].sizes:
        for posed in members(name, size, 100):
            problem = LCP(posed.M, posed.q)
            assert scaled_residual(problem, solve(problem).z) <= 1e-10


@pytest.mark.parametrize("size", [2, 3, 4])
def test_whole_numbers_are_solved_or_refused_as_all_cells_say(size: int) -> None:
    for posed in members("small integers", size, 30):
        problem = LCP(posed.M, posed.q)
        if lcp_has_solution(posed.M, posed.q):
            assert scaled_residual(problem, solve(problem).z) <= 1e-12
        else:
            with pytest.raises(InfeasibleError):
                solve(problem)


def test_a_basic_component_that_is_rounding_alone_is_zero() -> None:
    """q_2 = 0, and the only terms of w_2 are those of z_1, which is zero but basic."""
    problem = LCP([[0.7, 0.2, 2.3], [-0.2, 0, -1.9], [-2.3, 1.9, 0.7]], [-0.7, 0, 0.6])
    found = solve_lemke(problem)
    np.testing.assert_allclose(found.z, [0.0, 3.5, 0.0], rtol=1e-15)
    assert found.z[0] == 0.0
    assert scaled_residual(problem, np.array([1.5e-33, 3.5, 0.0])) <= 1e-15


def test_a_row_of_small_terms_of_its_own_is_still_measured_by_them() -> None:
    problem = LCP(np.diag([1.0, 1.0]), [-1e9, -1e-9])
    assert scaled_residual(problem, np.array([1e9, 0.0])) == pytest.approx(1.0)
    np.testing.assert_allclose(solve(problem).z, [1e9, 1e-9], rtol=1e-15)
