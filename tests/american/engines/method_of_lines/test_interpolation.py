import numpy as np
import pytest

from pricing_core.american.engines.method_of_lines.interpolation import local_derivatives, run_around

NODES = np.linspace(-1.0, 1.0, 21)


@pytest.mark.parametrize("x", [-0.95, -0.333, 0.0, 0.71, 1.05])
def test_quintics_and_their_derivatives_are_exact(x):
    coefficients = np.array([[0.3, -1.0, 2.0, 0.5, -0.7, 1.1], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    values = np.array([np.polyval(c, NODES) for c in coefficients])
    found = local_derivatives(NODES, values, x)
    for row, c in zip(found, coefficients, strict=True):
        expected = [np.polyval(np.polyder(c, k), x) for k in range(4)]
        assert row == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [4.0, 0.0, 0.0]), (2, [4.0, 4.0, 0.0]), (3, [4.0, 4.0, 2.0])]
)
def test_few_usable_nodes_lower_the_degree(count, expected):
    nodes = np.array([2.0, 2.0 + 1e-3, 2.0 + 2e-3])[:count]
    found = local_derivatives(nodes, (nodes**2)[None, :], 2.0)
    assert found[0] == pytest.approx([*expected, 0.0], abs=2e-3)


def test_a_run_around_an_index_ends_where_the_entries_change():
    entries = np.array([True, True, False, True, True, True, False])
    assert [run_around(entries, index) for index in (0, 2, 4, 6)] == [(0, 2), (2, 3), (3, 6), (6, 7)]
    assert run_around(np.ones(3, dtype=bool), 1) == (0, 3)
