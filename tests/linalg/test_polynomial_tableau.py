import numpy as np
import pytest
from flint import fmpz_poly
from scipy.optimize import linprog

from pricing_core.linalg.polynomial_tableau import Tableau, can_increase, feasible, with_zero_basics


def constant_tableau(M, b):
    """x_basic + M x_nonbasic = b, the nonbasic variables first in number."""
    m, n = M.shape
    rows = [[fmpz_poly([int(a)]) for a in row] for row in np.column_stack([M, b])]
    return Tableau(fmpz_poly([1]), rows, tuple(range(n, n + m)), tuple(range(n)))


@pytest.mark.parametrize("seed", range(60))
def test_feasibility_and_largest_values_agree_with_a_floating_point_solver(seed):
    rng = np.random.default_rng(seed)
    M, b = rng.integers(-2, 3, (4, 3)), rng.integers(-2, 3, 4)
    expected = linprog(np.zeros(3), A_ub=M, b_ub=b)
    point = feasible(constant_tableau(M, b))
    assert (point is not None) == (expected.status == 0)
    if point is None:
        return
    x = np.zeros(7)
    for variable, row in zip(point.basic, point.rows, strict=True):
        x[variable] = int(row[-1][0]) / int(point.d[0])
    assert (x >= 0).all()
    assert M @ x[:3] + x[3:] == pytest.approx(b)
    cost = rng.integers(-2, 3, 3)
    best = linprog(-cost, A_ub=M, b_ub=b)
    larger = best.status != 0 or -best.fun > cost @ x[:3] + 1e-9
    coefficients = {j: fmpz_poly([int(c)]) for j, c in enumerate(cost) if c}
    assert can_increase(point, coefficients) == larger


@pytest.mark.parametrize("seed", range(30))
def test_equations_leave_the_same_feasible_set(seed):
    rng = np.random.default_rng(seed)
    M, b = rng.integers(-2, 3, (4, 4)), rng.integers(-2, 3, 4)
    expected = linprog(np.zeros(4), A_ub=M[2:], b_ub=b[2:], A_eq=M[:2], b_eq=b[:2])
    reduced = with_zero_basics(constant_tableau(M, b), frozenset({4, 5}))
    point = None if reduced is None else feasible(reduced)
    assert (point is not None) == (expected.status == 0)


def test_signs_are_those_for_large_s():
    """x1 = s - 1000000 - x0 is feasible for large s, x1 = 1000000 - s - x0 is not."""
    one, s = fmpz_poly([1]), fmpz_poly([0, 1])
    assert feasible(Tableau(one, [[one, s - 1000000]], (1,), (0,))) is not None
    assert feasible(Tableau(one, [[one, 1000000 - s]], (1,), (0,))) is None
