import numpy as np
import pytest
from flint import fmpz_poly

from pricing_core.linalg.principal_minors import members_of, principal_minors, principal_solutions


def constants(M):
    return [[fmpz_poly([int(entry)]) for entry in row] for row in M]


@pytest.mark.parametrize("seed", range(20))
def test_all_minors_agree_with_determinants(seed):
    """Many entries are zero, so that principal pivots fail and rows are exchanged."""
    M = np.random.default_rng(seed).integers(-1, 2, (4, 4))
    for position, minor in enumerate(principal_minors(fmpz_poly([1]), constants(M))):
        chosen = members_of(position, 4)
        assert int(minor[0]) == round(np.linalg.det(M[np.ix_(chosen, chosen)]))


@pytest.mark.parametrize("seed", range(20))
def test_principal_solutions_satisfy_their_equations(seed):
    rng = np.random.default_rng(seed)
    M, q = rng.integers(-4, 5, (4, 4)), rng.integers(-4, 5, 4)
    seen = 0
    for solution in principal_solutions(fmpz_poly([1]), constants(M), [fmpz_poly([int(v)]) for v in q]):
        chosen = list(members_of(solution.members, 4))
        column = np.array([int(entry[0]) for entry in solution.column]) / int(solution.minor[0])
        u = np.zeros(4)
        u[chosen] = -column[chosen]
        y = column.copy()
        y[chosen] = 0.0
        assert M @ u + q == pytest.approx(y, abs=1e-10)
        seen += 1
    assert seen > 0
