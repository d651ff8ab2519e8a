import numpy as np
import pytest

from pricing_core.american.engines.method_of_lines.interpolation import local_derivatives, run_around

NODES = np.linspace(-1.0, 1.0, 21)
ALL = np.ones(21, dtype=bool)


@pytest.mark.parametrize("x", [-0.95, -0.333, 0.0, 0.71, 1.05])
def test_quintics_and_their_derivatives_are_exact(x):
    coefficients = np.array([[0.3, -1.0, 2.0, 0.5, -0.7, 1.1], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    values = np.array([np.polyval(c, NODES) for c in coefficients])
    found = local_derivatives(NODES, values, ALL, x)
    for row, c in zip(found, coefficients, strict=True):
        expected = [np.polyval(np.polyder(c, k), x) for k in range(4)]
        assert row == pytest.approx(expected, abs=1e-8)


def test_nodes_that_are_not_usable_do_not_count():
    values = np.where(NODES < 0.2, 1e6, NODES**2)[None, :]
    found = local_derivatives(NODES, values, NODES >= 0.2, 0.21)
    assert found[0] == pytest.approx([0.0441, 0.42, 2.0, 0.0], abs=1e-8)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [4.0, 0.0, 0.0]), (2, [4.0, 4.0, 0.0]), (3, [4.0, 4.0, 2.0])]
)
def test_few_usable_nodes_lower_the_degree(count, expected):
    nodes = np.array([2.0, 2.0 + 1e-3, 2.0 + 2e-3])[:count]
    found = local_derivatives(nodes, (nodes**2)[None, :], np.ones(count, dtype=bool), 2.0)
    assert found[0] == pytest.approx([*expected, 0.0], abs=2e-3)


def test_run_around_an_index_is_bounded_by_the_unusable_neighbours():
    usable = np.array([True, True, False, True, True, True, False])
    assert np.flatnonzero(run_around(usable, 0)).tolist() == [0, 1]
    assert np.flatnonzero(run_around(usable, 4)).tolist() == [3, 4, 5]
    assert run_around(np.ones(3, dtype=bool), 1).all()
