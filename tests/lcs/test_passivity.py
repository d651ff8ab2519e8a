import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from pricing_core.lcs import LCS, passivity
from pricing_core.lcs.rational_system import rational_system
from pricing_core.linalg.rational_definite import is_exactly_positive_definite, negative_vector
from tests.problems.lcs_systems import bridge, filtered_bridge, integrators, oscillator, two_carts
from tests.problems.nightly import nightly


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
    (LCS([[0, 0], [0, 0]], [[1, 2], [0, 1]], [[1, 0], [0, 1]]), "no symmetric Q|semidefinite"),
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


def test_systems_beyond_the_limit_are_left_open():
    found = passivity(LCS(np.ones((40, 40)) - 50 * np.eye(40), 2 * np.eye(40), np.eye(40)))
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
    assert all(passivity(energy_conserving(seed, 4, 2, losses)).verdict for seed in range(10))


def short(x):
    """Return the numbers rounded to multiples of 2**-8, whose products with powers of two stay what they are."""
    return np.rint(256.0 * x) / 256.0


def port_hamiltonian(seed, size, kind):
    """A = (J - R) Q, B, C = B^T Q, D = K + L: R = 0 where lossless, L = 0 or of half rank but where it is full."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, size // 4 + 1))
    n = size - k
    H, B, K = short(rng.normal(size=(n, n))), short(rng.normal(size=(n, k))), short(rng.normal(size=(k, k)))
    L = short(rng.normal(size=(n, n)))
    R = np.zeros((n, n)) if "lossless" in kind else L @ L.T / 128 + np.eye(n) / 32
    D = {"full": np.eye(k) / 8, "half": np.diag(np.arange(k) % 2.0)}.get(kind.split()[-1], np.zeros((k, k)))
    Q = 2.0 ** rng.integers(-3, 4, n)
    return (H - H.T - R) * Q, B, B.T * Q, K - K.T + D


SIZES = [8, 25, *nightly((38, 60))]
KINDS = ["lossless", "lossless full", "lossless half", "strict", "strict full", "strict half"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_port_hamiltonian_systems_are_passive(size, kind):
    for seed in range(3 if size < 60 else 1):
        found = passivity(LCS(*port_hamiltonian(seed, size, kind)))
        assert found.verdict is True
        if size == 8:
            system = LCS(*port_hamiltonian(seed, size, kind))
            assert negative_vector(-inequality(system, found.exact_storage)) is None
            assert is_exactly_positive_definite(found.exact_storage)
        else:
            assert np.linalg.eigvalsh(found.storage)[0] > 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_port_hamiltonian_systems_that_deliver_energy_are_not_passive(size, kind):
    """A negative resistance of one state that no loss makes up for."""
    for seed in range(2):
        A, B, C, D = port_hamiltonian(seed, size, kind)
        A[0, 0] += 1.0 if "lossless" in kind else np.abs(A).sum()
        assert passivity(LCS(A, B, C, D)).verdict is False


@pytest.mark.parametrize(("share", "verdict"), [(1e-6, True), (-1e-6, False)])
@pytest.mark.parametrize("seed", range(4))
def test_passivity_is_told_close_to_its_limit(seed, share, verdict):
    """D + D^T is lowered until G + G^* has a least eigenvalue of plus or minus 1e-6 of what it was lowered by."""
    A, B, C, D = port_hamiltonian(seed, 28, "strict full")

    def least(omega):
        G = C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B) + D
        return np.linalg.eigvalsh(G + G.conj().T)[0]

    C = C - 4.0 * short(np.random.default_rng(seed).normal(size=C.shape))  # not with the energy of before
    heights = np.concatenate([[0.0], np.abs(np.linalg.eigvals(A).imag), np.logspace(-2, 4, 2000)])
    values = [least(omega) for omega in heights]
    at = heights[int(np.argmin(values))]
    around = minimize_scalar(least, bounds=(0.98 * at, 1.02 * at + 1e-9), options={"xatol": 1e-12})
    lowest = min(around.fun, *values)
    system = LCS(A, B, C, D - 0.5 * (1.0 - share * np.sign(lowest)) * lowest * np.eye(len(D)))
    assert passivity(system).verdict is verdict


@pytest.mark.parametrize("seed", range(20))
def test_systems_that_lose_nothing_at_some_frequencies_are_passive(seed):
    """The inverse of 1 + B^T (s - J)^-1 B is singular at all eigenvalues of the skew J, most of them irrational."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 7)), int(rng.integers(1, 3))
    H, B = rng.integers(-2, 3, (n, n)), rng.integers(-2, 3, (n, k))
    T = np.triu(rng.integers(-2, 3, (n, n)), 1) + np.eye(n, dtype=int)  # in other coordinates
    inverse = np.rint(np.linalg.inv(T)).astype(int)
    system = LCS(T @ (H - H.T - B @ B.T) @ inverse, T @ B, -B.T @ inverse, np.eye(k, dtype=int))
    found = passivity(system)
    assert found.verdict is True
    assert negative_vector(-inequality(system, found.exact_storage)) is None
    assert is_exactly_positive_definite(found.exact_storage)


@pytest.mark.parametrize("seed", range(200))
def test_small_systems_are_all_decided_and_rightly(seed):
    """Random integers: a storage function is checked, and a refutation by frequencies, or by the exact verification."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    F = rng.integers(-1, 2, (n + k, int(rng.integers(1, n + k + 1))))
    S, H, K = F @ F.T, rng.integers(-2, 3, (n, n)), rng.integers(-1, 2, (k, k))
    B = rng.integers(-1, 2, (n, k))
    changed = rng.integers(-1, 2, (k, n)) * (rng.random() < 0.5)
    system = LCS(H - H.T - S[:n, :n], B, B.T + 2 * S[n:, :n] + changed, K - K.T + S[n:, n:])
    found = passivity(system)
    if not changed.any():
        assert found.verdict is True
    if found.verdict:
        assert negative_vector(-inequality(system, found.exact_storage)) is None
        assert is_exactly_positive_definite(found.exact_storage)
    else:
        assert found.verdict is False
        poles = np.linalg.eigvals(system.A)
        heights = np.concatenate([np.logspace(-3, 3, 400), np.abs(poles.imag)])
        some = [complex(d, h) for h in heights for d in (1e-6, 1e-2)] + [
            complex(d, 0) for d in np.logspace(-4, 4, 99)
        ]
        assert poles.real.max() > -1e-9 or min(supplied(system, s) for s in some) < 1e-9


def supplied(system, s):
    """Return the least eigenvalue of G(s) + G(s)^*."""
    G = system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B) + system.D
    return np.linalg.eigvalsh(G + G.conj().T)[0]
