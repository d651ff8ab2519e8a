from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american.engines.method_of_lines.operators import ThreePointOperator
from pricing_core.american.engines.method_of_lines.stage import (
    StageProblem,
    TridiagonalStage,
    UnconstrainedStage,
    implicit_matrix,
    natural_residual,
    start_state,
)
from pricing_core.errors import NumericalError
from pricing_core.stepping import SDIRK2, DiagonallyImplicit
from tests.problems.segment_forms import CONTRACTS, segment_form


def test_the_problem_of_a_stage_is_that_of_the_chapter():
    """(I - hL) v = base + h e + h u, 0 <= u _|_ v - g >= 0, in z = v - g and w = h u."""
    form, values = segment_form(CONTRACTS["escrowed put"], 30)
    h, t, base = 0.02, 0.3, values[1:-1] + 0.01
    problem = StageProblem.of(form, t, base, h)
    v = np.random.default_rng(2).uniform(0.0, 1.0, base.size)
    everywhere = form.everywhere(v, t)
    z = v - form.obstacle(t, form.grid.interior)
    held = v - h * form.operator.apply(everywhere) - base
    assert problem.M.times(z) + problem.q == pytest.approx(held, abs=1e-13)


@pytest.mark.parametrize("case", CONTRACTS)
def test_complementarity_holds_after_a_step(case):
    form, values = segment_form(CONTRACTS[case], 200)
    state = (
        DiagonallyImplicit(TridiagonalStage(form), SDIRK2).step(0.0, start_state(form, values), 1e-2).state
    )
    assert np.all(state.slack >= 0)
    assert np.all(state.multiplier >= 0)
    assert np.max(state.slack * state.multiplier / form.scale) < 1e-12
    assert state.contact.any()


@pytest.mark.parametrize("lcp_method", ["policy", "psor", "lemke"])
@pytest.mark.parametrize("case", CONTRACTS)
def test_every_lcp_method_takes_the_same_steps(case, lcp_method):
    form, values = segment_form(CONTRACTS[case], 60)
    expected = found = start_state(form, values)
    size = form.scale
    for k in range(3):
        expected = DiagonallyImplicit(TridiagonalStage(form), SDIRK2).step(0.01 * k, expected, 0.01).state
        found = (
            DiagonallyImplicit(TridiagonalStage(form, lcp_method), SDIRK2).step(0.01 * k, found, 0.01).state
        )
        assert np.all(np.abs(found.value - expected.value) <= 1e-12 * size)
        # The last sweep of PSOR is checked against the largest entry of q.
        assert found.residual < 1e-13 * size.max()


@pytest.mark.parametrize("lcp_method", ["tridiagonal", "policy"])
def test_an_exercise_region_with_a_hole_is_found_from_any_start(lcp_method):
    form, values = segment_form(CONTRACTS["put"], 200)
    h, nodes = 1e-3, form.grid.interior
    base = values[1:-1] + 0.05 * np.exp(-(((np.log(nodes) + 0.2) / 0.03) ** 2))  # held around S = 82
    start = start_state(form, values)
    expected = TridiagonalStage(form, "lemke").solve(h, base, h, start)
    assert np.count_nonzero(np.diff(expected.contact)) == 3  # exercised, held, exercised, held
    for near in (start, expected):
        found = TridiagonalStage(form, lcp_method).solve(h, base, h, near)
        assert found.value == pytest.approx(expected.value, abs=1e-12)
        assert found.multiplier == pytest.approx(expected.multiplier, abs=1e-9)
        assert found.residual < 1e-14
        np.testing.assert_array_equal(found.contact, expected.contact)


def test_what_may_not_be_exercised_is_one_linear_system():
    form, values = segment_form(CONTRACTS["put"], 60)
    form = replace(form, segment=replace(form.segment, exercisable=False, exercise_at_end=False))
    h, base = 0.05, values[1:-1]
    state = UnconstrainedStage(form).solve(h, base, h, start_state(form, values))
    everywhere = form.everywhere(state.value, h)
    assert state.value - h * form.operator.apply(everywhere) == pytest.approx(base, abs=1e-13)
    assert not state.contact.any()
    assert not state.multiplier.any()
    assert state.residual == 0.0


def test_contact_at_the_start_needs_the_right_to_exercise():
    form, values = segment_form(CONTRACTS["put"], 40)
    assert start_state(form, values).contact.any()
    held = replace(form, segment=replace(form.segment, exercisable=False))
    assert not start_state(held, values).contact.any()


@pytest.mark.parametrize("lcp_method", ["tridiagonal", "policy"])
def test_a_pivot_of_zero_is_told_with_its_remedy(lcp_method):
    form, values = segment_form(CONTRACTS["put"], 20)
    nothing = np.zeros(19)
    singular = replace(form, operator=ThreePointOperator(nothing, np.ones(19), nothing))
    start = replace(start_state(singular, values), contact=np.zeros(19, dtype=bool))
    with pytest.raises(NumericalError, match="take more time steps"):
        TridiagonalStage(singular, lcp_method).solve(1.0, values[1:-1], 1.0, start)


def test_the_implicit_matrix_and_the_natural_residual():
    operator = ThreePointOperator(*np.arange(9.0).reshape(3, 3))
    M = implicit_matrix(operator, 0.5)
    np.testing.assert_allclose(M.matrix.dense(), np.eye(3) - 0.5 * operator.matrix.dense())
    assert natural_residual(np.array([0.0, 2.0]), np.array([1.0, 0.0])) == 0.0
    assert natural_residual(np.array([0.1, 2.0]), np.array([1.0, -0.3])) == pytest.approx(0.3)
    assert natural_residual(
        np.array([0.1, 2.0]), np.array([1.0, -0.3]), np.array([1.0, 10.0])
    ) == pytest.approx(0.1)
