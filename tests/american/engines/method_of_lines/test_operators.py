import numpy as np
import pytest

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.method_of_lines.grid import Grid, SpotRange
from pricing_core.american.engines.method_of_lines.operators import difference_operators, spot_operator

RANGE = SpotRange(0.4, 2.5, 0.0, 0.3)


def segment(rate, volatility, dividend_yield=0.0):
    return Segment(0.0, 1.0, rate, dividend_yield, volatility, True, True, 0.0, 0.0, 0.0, 0.0)


def test_on_a_uniform_grid_the_differences_are_those_of_the_chapter():
    """(11.60)-(11.61), typed in as printed."""
    n, h = 19, 0.1
    first, second, identity = difference_operators(Grid(1.0 + h * np.arange(n + 2)))
    A1 = (np.eye(n, k=1) - np.eye(n, k=-1)) / (2 * h)
    A2 = (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)) / h**2
    for operator, expected in ((first, A1), (second, A2), (identity, np.eye(n))):
        assert np.allclose(operator.matrix.dense(), expected, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("stretching", [0.0, 3.0])
@pytest.mark.parametrize("span", [RANGE, RANGE.down_to_zero()], ids=["above zero", "down to zero"])
def test_the_second_difference_is_exact_for_parabolas_and_the_first_for_them_too(span, stretching):
    grid = span.grid(25, stretching)
    s = grid.nodes
    first, second, _ = difference_operators(grid)
    v = 1 + 2 * s + 3 * s**2
    assert first.apply(v) == pytest.approx(2 + 6 * s[1:-1], abs=1e-11)
    assert second.apply(v) == pytest.approx(np.full(24, 6.0), abs=1e-8)


@pytest.mark.parametrize("stretching", [0.0, 3.0])
def test_the_operator_is_exact_for_parabolas(stretching):
    """(11.59) with a yield: sigma**2 s**2/2 v'' + (r - q) s v' - r v."""
    grid = RANGE.grid(25, stretching)
    s = grid.nodes[1:-1]
    operator, fitted = spot_operator(grid, segment(0.05, 0.4, 0.02), (1.0,))
    v = 1 + 2 * grid.nodes + 3 * grid.nodes**2
    expected = 0.5 * 0.16 * s**2 * 6 + 0.03 * s * (2 + 6 * s) - 0.05 * v[1:-1]
    assert operator.apply(v) == pytest.approx(expected, abs=1e-11)
    assert not fitted


def test_what_a_bond_and_a_share_are_worth_is_carried_exactly():
    """L 1 = -r and L s = -q s: deep in the money nothing is lost."""
    grid = RANGE.grid(40, 1.0)
    operator, _ = spot_operator(grid, segment(0.05, 0.3, 0.02), (1.0,))
    assert operator.apply(np.ones(41)) == pytest.approx(np.full(39, -0.05), abs=1e-12)
    assert operator.apply(grid.nodes) == pytest.approx(-0.02 * grid.nodes[1:-1], abs=1e-12)


def test_the_matrix_acts_on_the_unknowns_and_the_ends_enter_the_first_and_last_row():
    grid = RANGE.grid(12, 0.0)
    operator, _ = spot_operator(grid, segment(0.05, 0.3), (1.0,))
    v = np.random.default_rng(1).normal(size=13)
    inside = operator.times(v[1:-1])
    assert inside == pytest.approx(operator.matrix.dense() @ v[1:-1], abs=1e-12)
    rest = operator.apply(v) - inside
    assert rest[[0, -1]] == pytest.approx([operator.lower[0] * v[0], operator.upper[-1] * v[-1]])
    assert np.abs(rest[1:-1]).max() < 1e-12


@pytest.mark.parametrize("rate", [0.3, -0.3])
@pytest.mark.parametrize("volatility", [0.0, 1e-3, 1e-2, 0.1])
def test_coarse_cells_are_fitted_so_that_the_step_keeps_an_m_matrix(volatility, rate):
    operator, fitted = spot_operator(RANGE.grid(10, 0.0), segment(rate, volatility), (1.0,))
    assert fitted
    assert np.all(operator.lower >= 0.0)
    assert np.all(operator.upper >= 0.0)


def test_fitting_is_told_where_it_is_watched_alone():
    # Cells around the strike are fine enough, those far out are not.
    grid = SpotRange(0.05, 20.0, 0.0, 1.0).grid(60, 8.0)
    numbers = segment(0.1, 0.2)
    assert not spot_operator(grid, numbers, (1.0,))[1]
    assert spot_operator(grid, numbers, (1.0, 19.0))[1]
