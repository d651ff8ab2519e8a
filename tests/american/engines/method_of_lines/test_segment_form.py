import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.engines.method_of_lines.stage import TridiagonalStage, start_state
from pricing_core.lcs import LCSStage, LCSState, TimeStepping, simulate
from pricing_core.stepping import IMPLICIT_EULER, SDIRK2, DiagonallyImplicit
from tests.problems.segment_forms import CONTRACTS, segment_form

ESCROWED = ("escrowed put", "escrowed call")


@dataclass(frozen=True)
class ExactExponentials:
    """The general stage, told the exact values of the two exponentials among its states.

    Implicit Euler would carry e^{-rt} as 1/(1 + r h): an O(h) error that the option's own stage does not have.
    """

    stage: LCSStage
    unknowns: int

    def solve(self, t, base, h, near):
        decay = -np.diag(self.stage.system.A)[self.unknowns + 1 :]
        base = base.copy()
        base[self.unknowns + 1 :] = np.exp(-decay * t) * (1.0 + h * decay)
        return self.stage.solve(t, base, h, near)


def marched(form, values, tableau, h, steps, general_stage):
    """Return the last states of the option's own stages and of the general LCS step."""
    system, x = form.as_lcs(values)
    unknowns = form.grid.interior.size
    general = LCSState(x, np.zeros(unknowns), np.zeros(unknowns))
    own = start_state(form, values)
    general_method = DiagonallyImplicit(general_stage(LCSStage(system)), tableau)
    own_method = DiagonallyImplicit(TridiagonalStage(form), tableau)
    for k in range(steps):
        general = general_method.step(k * h, general, h).state
        own = own_method.step(k * h, own, h).state
    return own, general


@pytest.mark.parametrize("h", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("stretching", [0.0, 2.0])
@pytest.mark.parametrize("tableau", [IMPLICIT_EULER, SDIRK2])
@pytest.mark.parametrize("case", CONTRACTS)
def test_the_options_own_step_equals_the_general_lcs_step(case, tableau, stretching, h):
    """(11.65) for the system (11.63), solved as an LCP for u by the general library, three steps in a row."""
    form, values = segment_form(CONTRACTS[case], 60, stretching=stretching)
    unknowns = form.grid.interior.size
    own, general = marched(form, values, tableau, h, 3, lambda stage: ExactExponentials(stage, unknowns))
    size = np.maximum(form.grid.interior, 1.0)
    assert np.all(np.abs(own.value - general.value[:unknowns]) <= 1e-10 * size)
    assert np.all(np.abs(own.slack - general.slack) <= 1e-10 * size)
    assert np.all(np.abs(own.multiplier - general.multiplier) <= 1e-8 * size)
    assert np.max(own.multiplier) > 1e-3
    assert own.residual < 1e-12


@pytest.mark.parametrize("case", ["put", "call", *ESCROWED])
def test_one_implicit_euler_step_of_the_system_as_it_stands(case):
    """Its exponentials e^{-rt} become 1/(1 + r h): r**2 h**2/2 of what depends on them."""
    form, values = segment_form(CONTRACTS[case], 60)
    h, unknowns = 1e-3, form.grid.interior.size
    own, general = marched(form, values, IMPLICIT_EULER, h, 1, lambda stage: stage)
    segment = form.segment
    gap = max(abs(math.exp(-r * h) - 1.0 / (1.0 + r * h)) for r in (segment.rate, segment.dividend_yield))
    size = np.maximum(form.grid.nodes[-1], 1.0)
    assert np.max(np.abs(own.value - general.value[:unknowns])) <= gap * size + 1e-12
    assert general.value[unknowns] == 1.0


@pytest.mark.parametrize("case", CONTRACTS)
def test_the_system_has_the_block_structure_and_the_start_of_the_chapter(case):
    """(11.63)-(11.64): B = [I; 0], C = [I, -g], x(0) = (v, 1); g = sign (1 - A e^{-rt} - s) has two parts."""
    form, values = segment_form(CONTRACTS[case], 12)
    system, x0 = form.as_lcs(values)
    segment, s = form.segment, form.grid.interior
    assert system.shape == (14, 11)
    assert np.array_equal(system.B, np.eye(14, 11))
    assert np.array_equal(system.C[:, :11], np.eye(11))
    assert np.allclose(system.C[:, 11], -form.sign * (1.0 - s), rtol=0.0, atol=1e-15)
    assert np.allclose(system.C[:, 12], form.sign * form.escrow, rtol=0.0, atol=1e-15)
    assert not system.C[:, 13].any()
    assert not system.D.any()
    assert np.array_equal(x0, [*values[1:-1], 1.0, 1.0, 1.0])
    assert np.array_equal(
        system.A[11:], np.diag([*np.zeros(12), -segment.rate, -segment.dividend_yield])[11:]
    )
    assert np.array_equal(system.A[:11, :11], form.operator.matrix.dense())
    assert not system.A[1:10, 11:].any()  # (11.55)-(11.56): the ends enter the first row and the last
    assert (form.escrow > 0.0) == (case in ESCROWED)


@pytest.mark.parametrize("case", CONTRACTS)
@pytest.mark.parametrize("t", [0.0, 0.3, 1.0])
def test_the_ends_and_the_obstacle_of_the_system_are_those_of_the_form(case, t):
    form, values = segment_form(CONTRACTS[case], 12)
    system, x0 = form.as_lcs(values)
    r, q = form.segment.rate, form.segment.dividend_yield
    state = np.concatenate([np.zeros(11), [1.0, math.exp(-r * t), math.exp(-q * t)]])
    ends = form.ends(t)
    forcing = system.A[:11] @ state
    expected = [form.operator.lower[0] * ends[0], form.operator.upper[-1] * ends[1]]
    assert forcing[[0, -1]] == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert system.C @ state == pytest.approx(-form.obstacle(t, form.grid.interior), abs=1e-14)
    assert np.array_equal(form.everywhere(x0[:11], t), [ends[0], *values[1:-1], ends[1]])


def test_the_end_deep_in_the_money_is_exercised_and_the_other_is_carried():
    form, _ = segment_form(CONTRACTS["put"], 12)
    assert form.contact_at_ends().tolist() == [True, False]
    assert form.ends(0.7) == pytest.approx([1.0 - form.grid.nodes[0], 0.0])
    call, _ = segment_form(CONTRACTS["call"], 12)
    assert call.contact_at_ends().tolist() == [False, True]
    held = replace(form.segment, exercisable=False)
    form = replace(form, segment=held)
    assert not form.contact_at_ends().any()
    assert form.ends(0.7)[0] == pytest.approx(math.exp(-0.05 * 0.7) - form.grid.nodes[0])


@pytest.mark.parametrize("case", CONTRACTS)
def test_the_curvature_beyond_a_boundary_is_what_exercise_earns(case):
    """sigma**2 s**2/2 J = sign (r - q s), also with an escrow, whose interest cancels."""
    form, _ = segment_form(CONTRACTS[case], 200)
    segment, s = form.segment, form.grid.interior
    for node in (0, 70, 198):
        expected = form.sign * (segment.rate - segment.dividend_yield * s[node])
        found = 0.5 * segment.volatility**2 * s[node] ** 2 * form.curvature(node)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_the_general_simulator_prices_the_option():
    """`simulate` knows nothing of options: 6.090371 is the true value, 3e-2 the error of this coarse grid."""
    form, values = segment_form(CONTRACTS["put"], 80, truncation=1e-6)
    system, x0 = form.as_lcs(values)
    method = TimeStepping(tolerance=0.0, absolute_tolerance=1e-5)
    trajectory = simulate(system, x0, (0.0, 1.0), method=method, t_eval=[1.0])
    value = 100 * np.interp(1.0, form.grid.interior, trajectory.x[-1, : form.grid.interior.size])
    assert value == pytest.approx(6.090371, abs=3e-2)


@pytest.mark.parametrize("volatility", [1e-3, 0.3])
def test_a_drift_that_dominates_is_told(volatility):
    form, _ = segment_form((Option("put", 100.0, 1.0), Market(100.0, 0.3, volatility)), 40)
    assert form.fitted == (volatility < 0.1)
