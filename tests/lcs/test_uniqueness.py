import numpy as np
import pytest

from pricing_core.lcs import LCS, Exosystem, rational_complementarity, simulate, sine, well_posedness
from pricing_core.lcs.ill_posedness import ambiguous_pairs
from pricing_core.lcs.parts import independent_parts, strongly_connected_parts
from pricing_core.lcs.pole_shifted_passivity import is_passive_after_pole_shift
from pricing_core.lcs.rational_system import rational_system
from pricing_core.lcs.total_invertibility import transfer_minors
from pricing_core.lcs.uniqueness import has_unique_state
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.models import MechanicalSystem
from tests.problems.lcs_systems import oscillator, random_system, two_integrators
from tests.problems.nightly import nightly


def side_by_side(rng, systems):
    """Put systems into one, their states and pairs shuffled."""
    sizes = np.array([system.shape for system in systems])
    n, k = sizes.sum(axis=0)
    A, B, C, D = np.zeros((n, n)), np.zeros((n, k)), np.zeros((k, n)), np.zeros((k, k))
    states, pairs = rng.permutation(n), rng.permutation(k)
    groups = []
    for system, (i, j) in zip(systems, np.cumsum(sizes, axis=0) - sizes, strict=True):
        x, u = states[i : i + system.shape[0]], pairs[j : j + system.shape[1]]
        A[np.ix_(x, x)], B[np.ix_(x, u)] = system.A, system.B
        C[np.ix_(u, x)], D[np.ix_(u, u)] = system.C, system.D
        groups.append((x, u))
    return LCS(A, B, C, D), groups


def symmetric(rng, n, k):
    """x' = Ax + Bu, y = B^T Q x with any A, Q > 0 and B of any rank."""
    rank = int(rng.integers(1, k + 1))
    B = rng.integers(-2, 3, (n, rank)) @ rng.integers(-1, 2, (rank, k))
    H = rng.integers(-1, 2, (n, n))
    return LCS(rng.integers(-4, 5, (n, n)), B, B.T @ (H @ H.T + np.eye(n, dtype=int)))


@pytest.mark.parametrize("seed", range(15))
def test_symmetric_systems_are_well_posed_whatever_their_rank_and_their_poles(seed):
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    system = symmetric(rng, n, k)
    report = well_posedness(system)
    assert report.verdict == "well-posed"
    assert has_unique_state(system)
    ambiguous = False
    for _ in range(5):
        found = rational_complementarity(system, rng.integers(-3, 4, n))
        assert found.solution_sets
        assert found.unique_state
        ambiguous |= not found.unique_input
    if ambiguous:
        assert report.input_unique is not True


@pytest.mark.parametrize("seed", range(60))
def test_what_is_proved_of_random_systems_holds_in_the_exact_problem(seed):
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    system = random_system(rng, n, k, feedthrough=seed % 2 == 0)
    if seed % 3 == 0:
        system = LCS(system.A, system.B, system.B.T, system.D @ system.D.T + system.D - system.D.T)
    if has_unique_state(system):
        for _ in range(6):
            assert rational_complementarity(system, rng.integers(-3, 4, n)).unique_state
    if is_passive_after_pole_shift(rational_system(system)):
        assert well_posedness(system).verdict == "well-posed"


def test_a_shift_decides_what_no_storage_function_of_the_system_itself_does():
    """x' = 3 x + u, y = x; and 1/s**2, which no shift makes passive."""
    assert is_passive_after_pole_shift(rational_system(LCS([[3]], [[1]], [[1]])))
    assert not is_passive_after_pole_shift(rational_system(LCS([[0, 1], [0, 0]], [[0], [1]], [[1, 0]])))


@pytest.mark.parametrize("seed", [*range(5), *nightly(range(5, 12))])
def test_up_to_24_pairs_are_examined_part_by_part(seed):
    rng = np.random.default_rng(seed)
    systems, pairs = [], 0
    while pairs < 13:
        n, k = int(rng.integers(1, 4)), int(rng.integers(2, 5))
        systems.append(symmetric(rng, n, k) if rng.random() < 0.9 else random_system(rng, n, k))
        pairs += k
    whole, groups = side_by_side(rng, systems)
    verdicts = [well_posedness(system).verdict for system in systems]
    report = well_posedness(whole)
    if set(verdicts) == {"well-posed"}:
        assert report.verdict == "well-posed"
    elif "ill-posed" not in verdicts:
        assert report.verdict == "unknown"
    if report.verdict == "ill-posed":
        shown = [
            rational_complementarity(system, report.witness[x])
            for system, (x, _) in zip(systems, groups, strict=True)
        ]
        assert not all(found.solution_sets and found.unique_state for found in shown)
        several = all(found.solution_sets for found in shown)
        assert report.counterexample.kind == ("several solutions" if several else "no solution")
    assert bool(has_unique_state(whole)) == all(has_unique_state(system) for system in systems)


@pytest.mark.parametrize("seed", range(20))
def test_minors_of_cascades_are_products_over_their_parts(seed):
    """P for large s, by the minors of the whole and by those of the strongly connected parts."""
    rng = np.random.default_rng(seed)
    n, k = 5, 4
    sparse = [
        rng.integers(-2, 4, shape) * (rng.random(shape) < 0.3) for shape in ((n, n), (n, k), (k, n), (k, k))
    ]
    system = LCS(*sparse[:3], sparse[3] + np.diag(rng.integers(0, 2, k)))
    parts = [part for part in strongly_connected_parts(system) if part.pairs]
    assert sorted(i for part in parts for i in part.pairs) == list(range(k))
    assert all(all_positive(transfer_minors(part.system)) for part in parts) == all_positive(
        transfer_minors(system)
    )


def test_parts_keep_their_inputs():
    f = Exosystem([[0.0]], [[1.0], [2.0]], [3.0])
    parts = independent_parts(LCS(np.zeros((2, 2)), np.eye(2), np.eye(2), f=f, g=[5, 7]))
    assert [(part.system.f.after(0.0).tolist(), part.system.g.after(0.0).tolist()) for part in parts] == [
        ([3.0], [5.0]),
        ([6.0], [7.0]),
    ]


def test_the_ambiguous_part_of_a_large_system_is_named():
    rng = np.random.default_rng(1)
    system, groups = side_by_side(
        rng, [oscillator(), *[two_integrators([[2, 1], [1, 2]])] * 6, oscillator(-1)]
    )
    x0 = np.zeros(system.shape[0])
    assert ambiguous_pairs(system, x0) is None
    x0[groups[-1][0][1]] = 1.0  # from (0, 1) there are two ways on
    assert ambiguous_pairs(system, x0) == tuple(groups[-1][1])


def test_an_offset_that_varies_is_not_taken_for_its_first_value():
    """y = sin(2 pi t): negative from t = 1/2 on, with no u that could help; with y = x + sin the state can."""
    assert well_posedness(LCS([[-1]], [[0]], [[0]], g=sine(1.0, 1.0))).verdict == "unknown"
    assert well_posedness(LCS([[-1]], [[1]], [[1]], g=sine(1.0, 1.0))).verdict == "well-posed"
    assert well_posedness(LCS([[-1]], [[0]], [[0]], [[0]], g=[0])).verdict == "well-posed"


@pytest.mark.parametrize("seed", [0, 1, 3, 4, *nightly([2, *range(5, 12)])])
def test_independent_constraints_of_any_number_leave_one_motion(seed):
    """F M^-1 F^T > 0: with up to 30 contacts, and not where a constraint is stated twice with another sign."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 31))
    k = int(rng.integers(1, n + 1))
    H = rng.normal(size=(n, n))
    F = rng.normal(size=(k, n)) * 10.0 ** rng.uniform(-6.0, 6.0, (k, 1))
    body = MechanicalSystem(H @ H.T + np.eye(n), rng.normal(size=(n, n)), rng.normal(size=(n, n)), F)
    system = body.to_lcs()
    assert has_unique_state(system)
    assert not has_unique_state(LCS(system.A, -system.B, system.C))


def test_what_is_proved_of_a_run_is_proved_of_its_system():
    """Relays with u = sgn y have several ways on from 0; under another law of impact nothing is known."""
    body = MechanicalSystem([[1.0]], [[0.0]], [[1.0]], [[1.0]], offset=[0.5])
    assert body.simulate([1.0], [0.0], (0.0, 5.0)).unique
    elastic = MechanicalSystem([[1.0]], [[0.0]], [[1.0]], [[1.0]], offset=[0.5], restitution=0.5)
    assert elastic.simulate([1.0], [0.0], (0.0, 5.0)).unique is None
    several = two_integrators([[1, 2], [2, 1]])
    assert simulate(several, [1.0, 1.0], (0.0, 1.0)).unique is None
    nearly = LCS(several.A, [[1.0, 1.0 - 2.0**-53], [1.0 + 2.0**-52, 1.0]], several.C)
    assert (simulate(nearly, [1.0, 1.0], (0.0, 1.0)).unique is True) == all_positive(transfer_minors(nearly))
