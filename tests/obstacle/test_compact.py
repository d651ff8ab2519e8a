"""The compact scheme: its order, and under which rule the matrix of a stage is an M-matrix."""

import numpy as np
import pytest

from pricing_core.obstacle.compact import CompactScheme, product


def residual(n, diffusion, drift, V):
    """sum weights F - sum operator V for a smooth V on [0, 1], F = D V'' + m V' from its derivatives."""
    h = 1.0 / n
    x = h * np.arange(n + 1)
    D, m = diffusion(x), drift(x)
    scheme = CompactScheme.of(D / h**2, m / h)
    v, first, second = V(x)
    found = product(scheme.weights, D * second + m * first) - product(scheme.operator, v)
    return np.abs(found[3:-3]).max() / h**2  # differences of the coefficients are one-sided at the ends


def wave(x):
    return np.sin(3.0 * x + 0.4), 3.0 * np.cos(3.0 * x + 0.4), -9.0 * np.sin(3.0 * x + 0.4)


@pytest.mark.parametrize(
    ("diffusion", "drift"),
    [
        (lambda x: np.full(x.size, 0.3), lambda x: np.full(x.size, 0.0)),
        (lambda x: np.full(x.size, 0.3), lambda x: np.full(x.size, -0.8)),
        (lambda x: 0.3 + 0.1 * np.sin(2.0 * x), lambda x: 0.5 + np.cos(x)),
    ],
    ids=["diffusion", "drift", "variable"],
)
def test_the_order_is_four(diffusion, drift):
    errors = [residual(n, diffusion, drift, wave) for n in (20, 40, 80, 160)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[-1] == pytest.approx(4.0, abs=0.15), errors


@pytest.mark.parametrize("p", [0.0, 0.5, -1.5, 8.0, -50.0])
def test_the_operator_has_the_signs_of_diffusion_for_every_cell_peclet_number(p):
    """1 -/+ p/2 + p^2/12 > 0: its discriminant is 1/4 - 1/3 < 0."""
    scheme = CompactScheme.of(np.full(9, 2.0), np.full(9, 2.0 * p))
    assert (scheme.operator[[0, 2]] > 0.0).all()
    assert scheme.operator.sum(axis=0) == pytest.approx(0.0, abs=1e-12 * (1.0 + p * p))


def stage_matrix(D, p, r, a, n):
    scheme = CompactScheme.of(np.full(n + 2, D), np.full(n + 2, D * p))
    bands = (scheme.weights * (1.0 / a + r) - scheme.operator)[:, 1:-1]
    return np.diag(bands[1]) + np.diag(bands[0, 1:], -1) + np.diag(bands[2, :-1], 1)


@pytest.mark.parametrize("p", [0.0, 0.7, -1.9, 3.0])
@pytest.mark.parametrize("r", [-0.3, 0.0, 0.2])
def test_the_stage_matrix_is_an_m_matrix_exactly_from_the_step_of_the_rule_on(p, r):
    """With held ends: a D >= (1 + a r)/12 (1 + |p|/2)/(1 + |p|/2 + p^2/12), which a D >= (1 + a r)/12 implies."""
    D, n = 1.0, 24
    factor = (1.0 + abs(p) / 2.0) / (
        1.0 + abs(p) / 2.0 + p * p / 12.0
    )  # of the off-diagonal entry that binds
    other = (1.0 - abs(p) / 2.0) / (1.0 - abs(p) / 2.0 + p * p / 12.0)
    binding = max(factor, other)
    smallest = binding / 12.0 / (D - r * binding / 12.0)  # a D = (1 + a r) binding/12
    assert binding <= 1.0
    for a, expected in ((1.001 * smallest, True), (0.97 * smallest, False)):
        A = stage_matrix(D, p, r, a, n)
        off = A - np.diag(np.diag(A))
        assert (off.max() <= 0.0) == expected
        if expected:
            assert (np.linalg.inv(A) >= 0.0).all()


@pytest.mark.parametrize("p", [0.5, -0.5])
def test_a_linear_end_once_eliminated_has_a_wrong_sign_on_one_side(p):
    """V_0 = 2 V_1 - V_2 leaves -p (1 - 1/(12 a D)) next to the diagonal: the theorem covers held ends alone."""
    D, n, a = 1.0, 12, 0.5
    A = stage_matrix(D, p, 0.0, a, n)
    lower = (1.0 / 12.0 - p / 24.0) / (a * D) - (1.0 - p / 2.0 + p * p / 12.0)
    A[0, 0] += 2.0 * lower
    A[0, 1] -= lower
    assert A[0, 1] == pytest.approx(-p * (1.0 - 1.0 / (12.0 * a * D)), abs=1e-14)
    assert (np.linalg.inv(A).min() < -0.01) == (p < 0.0)
