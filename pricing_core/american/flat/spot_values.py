"""What one solve says at one spot: value, slope and curvature in log-moneyness, parameter derivatives."""

import math

import numpy as np

from pricing_core.american.flat.closed_form import LARGEST_EXPONENT, european_values
from pricing_core.american.flat.exercise_region import ExerciseRegion, exercise_region
from pricing_core.american.flat.interpolation import local_derivatives, run_around
from pricing_core.american.flat.resolution import Solution
from pricing_core.arrays import Matrix


def region_of(solution: Solution, index: int = -1) -> ExerciseRegion:
    """Return the exercise region of one of the solution's states."""
    domain = solution.form.domain
    return exercise_region(
        solution.integration.states[index],
        solution.form.grid.interior,
        domain.contact_at_left,
        domain.contact_at_right,
    )


def values_at(solution: Solution, region: ExerciseRegion, x: float) -> Matrix:
    """Return v and its derivatives at x now, shape (m, 3).

    Row 0 is v, v_x, v_xx; rows 1-3, where present, begin with dv/dsigma, dv/dr, dv/dq.
    """
    form, state = solution.form, solution.last
    nodes, interior = form.grid.nodes, form.grid.interior
    beyond_left, beyond_right = x <= nodes[0], x >= nodes[-1]
    if (
        region.contains(x)
        or (beyond_left and form.domain.contact_at_left)
        or (beyond_right and form.domain.contact_at_right)
    ):
        return exercised_values(solution, x)
    european = european_rows(solution, x)
    if beyond_left or beyond_right:  # the premium is below the truncation there
        return european
    free = ~state.contact
    nearest = int(np.argmin(np.abs(interior - x)))
    if not free[nearest]:  # between the boundary and the first free node
        nearest = min(max(nearest + (1 if x > region.upper else -1), 0), free.size - 1)
    if not free[nearest]:
        return european
    on_grid = local_derivatives(interior, state.value, run_around(free, nearest), x)
    return on_grid if solution.resolution.formulation == "value" else on_grid + european


def exercised_values(solution: Solution, x: float) -> Matrix:
    """Return the payoff at x in the form of `values_at`; it depends on no market parameter."""
    rows = np.zeros((solution.last.value.shape[0], 3))
    sign = -1.0 if solution.form.option.is_put else 1.0
    moneyness = math.exp(min(x, LARGEST_EXPONENT))
    rows[0] = sign * (moneyness - 1.0), sign * moneyness, sign * moneyness
    return rows


def european_rows(solution: Solution, x: float) -> Matrix:
    """Return the European option at x in the form of `values_at`."""
    form = solution.form
    european = european_values(form.option.option_type, np.array([x]), form.option.expiry, form.market)
    rows = np.zeros((4, 3))
    rows[0] = european.value[0], european.slope[0], european.curvature[0] + european.slope[0]
    rows[1:, 0] = european.by_volatility[0], european.by_rate[0], european.by_yield[0]
    return rows[: solution.last.value.shape[0]]
