import numpy as np
import pytest

from pricing_core.american.engines.exercise_region import EMPTY_REGION
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.interpolation import (
    local_derivatives,
    nearest,
    run_around,
)
from pricing_core.american.engines.method_of_lines.spot_values import at_spots
from pricing_core.american.engines.method_of_lines.sweep_problem import Sweep

NODES = np.linspace(-1.0, 1.0, 21)


def local_around(nodes, values, x):
    near = nearest(nodes, x)
    return local_derivatives(nodes[None, near], values[None, :, near], np.array([x]))[0]


@pytest.mark.parametrize("x", [-0.95, -0.333, 0.0, 0.71, 1.05])
def test_quintics_and_their_derivatives_are_exact(x):
    coefficients = np.array([[0.3, -1.0, 2.0, 0.5, -0.7, 1.1], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    values = np.array([np.polyval(c, NODES) for c in coefficients])
    found = local_around(NODES, values, x)
    for row, c in zip(found, coefficients, strict=True):
        expected = [np.polyval(np.polyder(c, k), x) for k in range(4)]
        assert row == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [4.0, 0.0, 0.0]), (2, [4.0, 4.0, 0.0]), (3, [4.0, 4.0, 2.0])]
)
def test_few_usable_nodes_lower_the_degree(count, expected):
    nodes = np.array([2.0, 2.0 + 1e-3, 2.0 + 2e-3])[:count]
    found = local_around(nodes, (nodes**2)[None, :], 2.0)
    assert found[0] == pytest.approx([*expected, 0.0], abs=2e-3)


def test_a_run_around_an_index_ends_where_the_entries_change():
    entries = np.array([True, True, False, True, True, True, False])
    assert [run_around(entries, index) for index in (0, 2, 4, 6)] == [(0, 2), (2, 3), (3, 6), (6, 7)]
    assert run_around(np.ones(3, dtype=bool), 1) == (0, 3)


def test_a_grid_has_the_same_numbers_alone_and_beside_others():
    rng = np.random.default_rng(4)
    nodes, x = np.sort(rng.uniform(0.0, 2.0, (50, 6))), rng.uniform(0.5, 1.5, 50)
    values = rng.normal(size=(50, 1, 6))
    together = local_derivatives(nodes, values, x)
    for row in range(50):
        rows = slice(row, row + 1)
        np.testing.assert_array_equal(together[rows], local_derivatives(nodes[rows], values[rows], x[rows]))


def test_what_cannot_be_solved_leaves_the_other_sweeps_alone():
    grid, region = Grid(np.linspace(0.5, 2.0, 9)), EMPTY_REGION
    sweep = Sweep(grid, grid.nodes**2, 0.0, np.zeros(7, dtype=bool), region, (), 1, 0.0, False)
    # Seen from so far away the nodes are one.
    found = at_spots([sweep, sweep, sweep], [1.1, 1e40, 1.3])
    assert isinstance(found[1], np.linalg.LinAlgError)
    for value, s in ((found[0], 1.1), (found[2], 1.3)):
        assert value[0] == pytest.approx([s**2, 2.0 * s, 2.0, 0.0], abs=1e-9)
