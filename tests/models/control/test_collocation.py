"""The quadratic programme tends to the exact answer, at the order that the rows say."""

import numpy as np
import pytest

from pricing_core.models.control.collocation import collocate
from pricing_core.models.control.problem import LQData
from tests.problems.control_problems import (
    ControlProblem,
    caught_oscillator,
    lowered_cart,
    scalar_that_just_arrives,
    stopped_scalar,
)


def data_of(known: ControlProblem) -> LQData:
    p = known.problem
    return LQData(p.A, p.B, p.C, p.Q, p.x0, p.bound, p.horizon)


@pytest.mark.parametrize(
    ("known", "expected_order"),
    [
        (stopped_scalar(3.0), 2.0),
        (scalar_that_just_arrives(0.8), 2.0),
        (caught_oscillator(0.7, 2.0, 5.0), 2.0),
        (lowered_cart(1.5, 1.0, 3.0), 2.0),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_the_cost_converges_at_its_order(known: ControlProblem, expected_order: float):
    numbers = np.array([100, 200, 400, 800])
    errors = [abs(collocate(data_of(known), int(N)).cost - known.cost) for N in numbers]
    order = -np.polyfit(np.log(numbers), np.log(errors), 1)[0]
    assert order == pytest.approx(expected_order, abs=0.15)


def test_costate_and_masses_have_the_signs_of_the_text():
    solution = collocate(data_of(stopped_scalar(3.0)), 400)
    h = 3.0 / 400
    assert solution.costate[-1, 0] == pytest.approx(1.0, abs=1e-3)
    assert solution.masses[300, 0] / h == pytest.approx(2.0, abs=1e-3)
    assert solution.masses[-1, 0] == pytest.approx(
        1.0 + h / 2 * 2, abs=1e-3
    )  # the atom, and half an interval
    assert solution.control == pytest.approx(solution.costate, abs=1e-6)  # u = B^T lambda
