import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.flat.grid import Domain, Grid, exercise_domain, make_grid
from pricing_core.american.flat.operators import black_scholes_operator
from pricing_core.american.flat.semidiscrete import PremiumForm, ValueForm
from pricing_core.errors import InvalidInputError
from pricing_core.lcs import simulate

PUT, MARKET = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)
PLAIN = Domain(-1.0, 1.0, True, False, 1e-8)


def chapter_matrix(n, h, rate, volatility):
    """(11.60)-(11.62), typed in as printed."""
    A1 = (np.eye(n, k=1) - np.eye(n, k=-1)) / (2 * h)
    A2 = (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)) / h**2
    return 0.5 * volatility**2 * A2 + (rate - 0.5 * volatility**2) * A1 - rate * np.eye(n)


def test_interior_rows_are_those_of_the_chapter():
    grid = make_grid(PLAIN, 20)
    L = black_scholes_operator(grid, MARKET).operator.matrix.dense()
    expected = chapter_matrix(19, 0.1, MARKET.rate, MARKET.volatility)
    assert np.allclose(L[1:-1], expected[1:-1], rtol=0, atol=1e-12)


def test_lcs_has_the_block_structure_and_the_start_of_the_chapter():
    """(11.63)-(11.64): A with a zero last row, B = [I; 0], C = [I, -g], x(0) = (g, 1)."""
    form = ValueForm.discretise(PUT, MARKET, PLAIN, make_grid(PLAIN, 12))
    system, x0 = form.as_lcs()
    g = np.maximum(1 - np.exp(form.grid.interior), 0)
    assert system.shape == (12, 11)
    assert np.array_equal(system.B, np.eye(12, 11))
    assert np.allclose(system.C, np.hstack([np.eye(11), -g[:, None]]), rtol=0, atol=1e-15)
    assert not system.D.any()
    assert not system.A[-1].any()
    assert np.allclose(x0, [*g, 1.0], rtol=0, atol=1e-15)
    # (11.56) decides the first row: v_0 = g(x_0) enters through the constant state; (11.55) the last: v = 0.
    operator = form.operators.operator
    assert system.A[0, -1] == pytest.approx(operator.lower[0] * (1 - math.exp(-1.0)))
    assert not system.A[1:, -1].any()


def test_the_general_simulator_prices_the_option():
    """`simulate` knows nothing of options: 6.090371 is the true value, 5e-3 the error of this coarse grid."""
    domain = exercise_domain(PUT, MARKET, 1e-6)
    form = ValueForm.discretise(PUT, MARKET, domain, make_grid(domain, 80))
    system, x0 = form.as_lcs()
    trajectory = simulate(system, x0, (0.0, 1.0), method="time-stepping", rtol=0.0, atol=1e-5, t_eval=[1.0])
    value = 100 * np.interp(0.0, form.grid.interior, trajectory.x[-1, :-1])
    assert value == pytest.approx(6.090371, abs=3e-2)


@pytest.mark.parametrize("stretching", [0.0, 3.0])
def test_operator_is_exact_for_parabolas(stretching):
    grid = make_grid(PLAIN, 25, stretching)
    x = grid.nodes
    market = Market(100.0, 0.05, 0.4, 0.02)
    drift, variance = 0.05 - 0.02 - 0.08, 0.16
    v = 1 + 2 * x + 3 * x**2
    expected = 0.5 * variance * 6 + drift * (2 + 6 * x) - 0.05 * v
    applied = black_scholes_operator(grid, market).operator.apply(v)
    assert applied == pytest.approx(expected[1:-1], abs=1e-11)


@pytest.mark.parametrize(("name", "size"), [("volatility", 1e-6), ("rate", 1e-6), ("dividend_yield", 1e-6)])
def test_operator_derivatives_are_those_of_the_operator(name, size):
    grid = make_grid(PLAIN, 10, 1.0)
    market = Market(100.0, 0.05, 0.4, 0.02)
    moved = [replace(market, **{name: getattr(market, name) + d}) for d in (size, -size)]
    up, down = (black_scholes_operator(grid, m).operator for m in moved)
    derivative = getattr(
        black_scholes_operator(grid, market),
        {"volatility": "by_volatility", "rate": "by_rate", "dividend_yield": "by_yield"}[name],
    )
    for band in ("lower", "diagonal", "upper"):
        difference = (getattr(up, band) - getattr(down, band)) / (2 * size)
        assert getattr(derivative, band) == pytest.approx(difference, abs=1e-6)


@pytest.mark.parametrize("volatility", [1e-3, 1e-2, 0.1])
def test_coarse_cells_are_fitted_so_that_the_step_keeps_an_m_matrix(volatility):
    result = black_scholes_operator(make_grid(PLAIN, 10), Market(100.0, 0.3, volatility))
    assert result.fitted
    assert np.all(result.operator.lower >= 0)
    assert np.all(result.operator.upper >= 0)


def test_premium_obstacle_and_its_derivatives_are_the_payoff_less_the_european_option():
    domain = exercise_domain(PUT, MARKET, 1e-6)
    form = PremiumForm.discretise(PUT, MARKET, domain, make_grid(domain, 16))
    constraint = form.constraint(0.5, 4)
    assert constraint.obstacle.shape == (4, 17)
    assert constraint.ends[0, 1] == 0.0
    assert constraint.ends[0, 0] == constraint.obstacle[0, 0]
    assert np.all(constraint.obstacle[1] <= 0)  # vega of the European option is positive


@pytest.mark.parametrize("nodes", [[0.0, 1.0], [0.0, 1.0, 1.0], [2.0, 1.0, 0.0]])
def test_grids_must_increase(nodes):
    with pytest.raises(InvalidInputError, match="nodes"):
        Grid(np.array(nodes))


def test_bad_grid_sizes_are_refused():
    with pytest.raises(InvalidInputError, match="intervals"):
        make_grid(PLAIN, 1)
