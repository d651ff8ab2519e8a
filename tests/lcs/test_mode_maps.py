import numpy as np
import pytest

from pricing_core.lcs import LCS
from pricing_core.lcs.autonomous import autonomous_form
from pricing_core.lcs.mode_maps import _Block, _general_maps, _uniform_maps, exact_maps, floating_maps
from pricing_core.lcs.modes import all_modes


def mechanical(rng: np.random.Generator) -> LCS:
    n, k = 3, 2
    M, F = np.diag(rng.uniform(0.5, 2.0, n)), rng.normal(size=(k, n))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.eye(n)), -0.1 * np.eye(n)]])
    return LCS(A, np.vstack([np.zeros((n, k)), np.linalg.solve(M, F.T)]), np.hstack([F, np.zeros((k, n))]))


def passive(rng: np.random.Generator) -> LCS:
    C, A = rng.normal(size=(2, 4)), rng.normal(size=(4, 4))
    return LCS(A, C.T, C)


def fed_through(rng: np.random.Generator) -> LCS:
    return LCS(
        rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), rng.normal(size=(2, 2))
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("make", [mechanical, passive, fed_through])
def test_maps_of_one_relative_degree_are_those_of_the_sequences_and_of_exact_arithmetic(make, seed):
    """As maps of z: W then V, W then the outputs, and the impulses, whatever the coordinates."""
    form = autonomous_form(make(np.random.default_rng(seed)))
    A, B, C, D = form.system.A, form.system.B, form.system.C, form.system.D
    for mode in all_modes(2):
        index = list(mode)
        block = _Block(A, B[:, index], C, D[:, index], index)
        quick = _uniform_maps(block)
        for other in (_general_maps(block), exact_maps(form, mode), floating_maps(form, mode)):
            for left, right in ((quick.basis, other.basis), (quick.outputs, other.outputs)):
                assert left @ quick.coordinates == pytest.approx(right @ other.coordinates, abs=1e-9)
            rates = quick.basis @ quick.rate @ quick.coordinates
            assert rates == pytest.approx(other.basis @ other.rate @ other.coordinates, abs=1e-9)
            assert quick.impulses == pytest.approx(other.impulses, abs=1e-9)


def test_coordinates_are_states_so_that_what_is_not_coupled_stays_apart():
    """A state of 1e9 beside a constraint x1 + x2 = 0 of states of 1."""
    C = [[1.0, 1.0, 0.0]]
    maps = floating_maps(autonomous_form(LCS(np.diag([-1.0, -2.0, -3.0]), np.transpose(C), C)), (0,))
    assert np.count_nonzero(maps.basis[2]) == 1
    assert np.count_nonzero(maps.outputs[:, np.flatnonzero(maps.basis[2])]) == 0
