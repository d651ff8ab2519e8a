"""What weights on the constraints prove."""

import math

import numpy as np
import pytest

from pricing_core.models.control.infeasibility import least_energy
from pricing_core.models.control.problem import LQData
from tests.problems.control_problems import FORCE, INTEGRATOR, POSITION


def test_the_energy_to_lift_a_cart_is_bounded_below_sharply():
    """x'' = u from rest at 0 to x(1) >= 1: u = 3 (1 - t), energy 3."""
    data = LQData(
        np.array(INTEGRATOR),
        np.array(FORCE),
        np.array(POSITION),
        np.zeros((2, 2)),
        np.zeros(2),
        np.array([1.0]),
        1.0,
    )
    weights = np.zeros((11, 1))
    weights[-1] = 1.0
    assert least_energy(data, weights) == pytest.approx(3.0, rel=1e-12)
    weights[3] = 1e-9  # what an interior-point method leaves
    assert least_energy(data, weights) == pytest.approx(3.0, rel=1e-6)


def test_out_of_reach_is_infinite_and_satisfied_is_nothing():
    A, B, C = np.diag([-1.0, 0.0]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    weights = np.array([[0.0], [1.0]])
    for bound, expected in ((1.0, math.inf), (0.0, 0.0)):
        data = LQData(A, B, C, np.eye(2), np.array([2.0, 0.0]), np.array([bound]), 3.0)
        assert least_energy(data, weights) == expected
