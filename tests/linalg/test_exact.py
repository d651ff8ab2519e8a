from fractions import Fraction

import numpy as np
import pytest

from pricing_core.linalg.exact import solve_exactly


@pytest.mark.parametrize("seed", range(20))
def test_the_solution_holds_exactly_and_d_is_the_determinant(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    M, R = rng.integers(-2, 3, (n, n)), rng.integers(-9, 10, (n, 2))
    solved = solve_exactly(M.tolist(), R.tolist())
    if solved is None:
        assert round(np.linalg.det(M)) == 0
    else:
        X, d = solved
        assert abs(d) == abs(round(np.linalg.det(M)))
        assert (M @ np.array(X) == d * R).all()


def test_numbers_far_beyond_floating_point_are_exact():
    large = 10**400
    X, d = solve_exactly([[large, 1], [1, 0]], [[1], [0]])
    assert (Fraction(X[0][0], d), Fraction(X[1][0], d)) == (0, 1)
    assert solve_exactly([[large, large + 1], [large - 1, large]], [[0], [0]]) == ([[0], [0]], 1)


def test_an_elimination_goes_on_where_another_one_stopped():
    """The Schur complement of 3 in (3 1 2; 1 4 1; 2 1 5), times 3, is (11 1; 1 11)."""
    whole = solve_exactly([[3, 1, 2], [1, 4, 1], [2, 1, 5]], [[0, 0], [3, 0], [0, 3]])
    rest = solve_exactly([[11, 1], [1, 11]], [[9, 0], [0, 9]], previous=3)
    assert whole is not None
    assert rest == (whole[0][1:], whole[1])
