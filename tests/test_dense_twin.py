"""The compiled Lemke path and equilibration against their NumPy twin, and both against what is known."""

from types import ModuleType

import numpy as np
import pytest

from benchmarks.lcs.lcp_classes import CLASSES, members
from pricing_core import dense_twin
from tests.problems.lcp_problems import fathi


@pytest.fixture(params=["rust", "numpy"])
def implementation(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "numpy":
        return dense_twin
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


def test_factors_are_powers_of_two_that_bring_entries_near_one(implementation: ModuleType) -> None:
    random = np.random.default_rng(0)
    for n in (1, 3, 10):
        row, column = 10.0 ** random.uniform(-100.0, 100.0, (2, n))
        factors = implementation.equilibrate(row[:, None] * random.normal(size=(n, n)) * column)
        M = factors[0][:, None] * row[:, None] * np.ones((n, n)) * column * factors[1]
        assert 0.01 < M.min() <= M.max() < 100.0
        for factor in factors:
            assert (np.frexp(factor)[0] == 0.5).all()


@pytest.mark.parametrize("name", [name for name in CLASSES if name != "opposite rows"])
def test_both_follow_the_same_path(name: str) -> None:
    compiled = pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")
    for size in [size for size in CLASSES[name].sizes if size <= 20]:
        for posed in members(name, size, 5):
            row, column = dense_twin.equilibrate(posed.M)
            M, q = row[:, None] * posed.M * column, row * posed.q
            ends = [k.lemke(M, q, np.ones(q.size), 5000) for k in (compiled, dense_twin)]
            assert ends[0][0] == ends[1][0]
            if ends[0][0] == "solved":
                for _, z, _, _ in ends:
                    w = M @ z + q
                    assert np.abs(np.minimum(z, w)).max() <= 1e-10 * (1.0 + np.abs(z).max())


@pytest.mark.parametrize("n", [1, 3, 6, 8])
def test_every_ratio_ties_on_the_path_of_fathi(implementation: ModuleType, n: int) -> None:
    end, z, basic_set, pivots = implementation.lemke(fathi(n), -np.ones(n), np.ones(n), 10_000)
    assert (end, pivots) == ("solved", 2**n)
    np.testing.assert_array_equal(z, np.eye(n)[0])
    np.testing.assert_array_equal(basic_set, np.eye(n, dtype=bool)[0])


def test_the_ends_of_a_path(implementation: ModuleType) -> None:
    one = np.ones(1)
    assert implementation.lemke(one[None], one, one, 9)[0] == "solved"
    assert implementation.lemke(-one[None], -one, one, 9)[0] == "ray"
    assert implementation.lemke(fathi(6), -np.ones(6), np.ones(6), 9)[0::3] == ("limit", 9)
    assert implementation.lemke(fathi(6), -np.ones(6), np.ones(6), 9, lambda: True)[0] in (
        "interrupted",
        "limit",
    )


def test_a_long_path_is_made_afresh_where_rounding_has_carried_it_off(implementation: ModuleType) -> None:
    """Hilbert matrices lose all digits within a few pivots; the point is that of the last basis all the same."""
    n = 12
    M = 1.0 / (1.0 + np.arange(n)[:, None] + np.arange(n)) + 1e-9 * np.eye(n)
    z0 = np.where(np.arange(n) % 2, 1.0, 0.0)
    q = np.where(z0 > 0.0, 0.0, 1.0) - M @ z0
    end, z, _, _ = implementation.lemke(M, q, np.ones(n), 10_000)
    assert end == "solved"
    assert np.abs(np.minimum(z, M @ z + q)).max() <= 1e-12
