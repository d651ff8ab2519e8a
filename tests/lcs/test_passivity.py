import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.lcs import LCS, passivity
from pricing_core.lcs.rational_system import rational_system
from pricing_core.linalg.rational_definite import is_exactly_positive_definite, negative_vector
from tests.problems.lcs_systems import bridge, filtered_bridge, integrators, oscillator, two_carts


def inequality(system, Q):
    """Return the matrix of (11.6), which must be negative semidefinite."""
    A, B, C, D = rational_system(system)
    return np.block([[A.T @ Q + Q @ A, Q @ B - C.T], [B.T @ Q - C, -(D + D.T)]])


def test_the_bridge_stores_energy_in_its_coil_and_capacitor():
    """Q = diag(C, L) solves (11.6) with equality (closed form)."""
    assert passivity(bridge()).storage.tolist() == [[1e-6, 0.0], [0.0, 1e-2]]


def test_the_filtered_bridge_is_passive_although_its_inequality_has_no_interior():
    """Q = diag(C, L, Cf) (closed form)."""
    assert passivity(filtered_bridge()).storage.tolist() == np.diag([1e-6, 1e-2, 3e-7]).tolist()


@pytest.mark.parametrize("growth", [1e-9, Fraction(1, 10**15)])
def test_a_tiny_negative_resistance_is_not_passive(growth):
    unit = bridge(1, 1, 1)
    A = [[growth, -1], [1, 0]]
    assert passivity(LCS(A, unit.B, unit.C, unit.D)).verdict is False
    assert passivity(LCS([[-growth, -1], [1, 0]], unit.B, unit.C, unit.D)).verdict is True


def test_a_gyrator_is_passive():
    assert passivity(LCS([[-1]], [[0, 0]], [[0], [0]], [[0, -1], [1, 0]])).verdict is True
    assert (
        passivity(LCS(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), [[0, -1], [1, 0]])).verdict
        is True
    )


# (system, part of the reason)
REFUTED = [
    (LCS([[-1]], [[1]], [[1]], [[-1]]), r"D \+ D\^T is negative"),
    (LCS([[1]], [[1]], [[1]], [[1]]), "eigenvalue"),
    (LCS([[0, 0], [0, 0]], [[1, 2], [0, 1]], [[1, 0], [0, 1]]), "no symmetric Q"),
    (oscillator(-1), r"G\(s\)"),
    (integrators(2), r"G\(s\)"),
    (two_carts(), r"G\(s\)"),
    (LCS([[-1]], [[3]], [[-1]], [[1]]), r"G\(s\)"),
]


@pytest.mark.parametrize(("system", "reason"), REFUTED)
def test_systems_that_are_not_passive_are_refuted(system, reason):
    found = passivity(system)
    assert found.verdict is False
    assert found.storage is None
    assert re.search(reason, found.reason)


def test_a_frequency_at_which_energy_is_delivered_is_reported():
    """G(0) = 1 - 3 < 0."""
    witness = passivity(LCS([[-1]], [[3]], [[-1]], [[1]])).witness
    assert witness.s.real > 0
    assert witness.value < 0


def test_an_exosystem_spoils_passivity():
    """A rectifier whose source is a state of the system: y = x - e with e' = Je from outside."""
    rectifier = LCS([[-1, 0, 0], [0, 0, 1], [0, -1, 0]], [[1], [0], [0]], [[1, -1, 0]])
    assert passivity(rectifier).verdict is not True
    assert passivity(LCS([[-1]], [[1]], [[1]])).verdict is True


def test_offsets_do_not_matter():
    assert passivity(LCS([[-1]], [[1]], [[1]], f=[5], g=[-7])).verdict is True


def test_large_systems_are_left_open():
    found = passivity(LCS(np.ones((40, 40)) - 50 * np.eye(40), np.eye(40), np.eye(40)))
    assert found.verdict is None
    assert "60" in found.reason


@pytest.mark.parametrize("seed", range(4))
def test_large_systems_are_decided_by_their_parts_or_by_the_unit_energy(seed):
    """Q = 1 where C = B^T and A + A^T <= 0, n + k = 50; a negative resistance there is found by a frequency."""
    rng = np.random.default_rng(seed)
    n, k = 36, 14
    H, B = rng.integers(-2, 3, (n, n)), rng.integers(-2, 3, (n, k))
    assert passivity(LCS(H - H.T - np.eye(n, dtype=int), B, B.T)).verdict is True
    side = passivity(LCS(-np.eye(20), np.eye(20), 4 * np.eye(20)))
    assert side.verdict is True
    assert side.storage.tolist() == (4 * np.eye(20)).tolist()
    assert passivity(LCS(H - H.T - np.eye(n, dtype=int), B, -B.T)).verdict is False


def energy_conserving(seed, n, k, losses):
    """A = (J - R) Q, C = B^T Q, D = K - K^T + losses: passive with storage function Q."""
    rng = np.random.default_rng(seed)
    H, L, M = rng.integers(-2, 3, (n, n)), rng.integers(-2, 3, (n, losses)), rng.integers(-2, 3, (n, n))
    B, K, d = rng.integers(-2, 3, (n, k)), rng.integers(-2, 3, (k, k)), rng.integers(-2, 3, (k, losses))
    Q = M @ M.T + np.eye(n, dtype=int)
    return LCS((H - H.T - L @ L.T) @ Q, B, B.T @ Q, K - K.T + d @ d.T)


@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3), st.integers(0, 2))
@settings(max_examples=30, deadline=None)
def test_circuits_are_never_refuted_and_every_certificate_is_exact(seed, n, k, losses):
    system = energy_conserving(seed, n, k, losses)
    found = passivity(system)
    assert found.verdict is not False
    if found.verdict:
        assert negative_vector(-inequality(system, found.exact_storage)) is None
        assert is_exactly_positive_definite(found.exact_storage)


@pytest.mark.parametrize("losses", [0, 1, 2])
def test_passive_systems_of_moderate_size_are_recognised(losses):
    found = [passivity(energy_conserving(seed, 4, 2, losses)).verdict for seed in range(10)]
    assert found.count(True) >= 9
