import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.flat.grid import exercise_domain, make_grid
from pricing_core.american.flat.semidiscrete import PremiumForm, ValueForm
from pricing_core.american.flat.tridiagonal_step import TridiagonalStage, start_state
from pricing_core.lcs import LCSStage, LCSState
from pricing_core.stepping import ImplicitEuler, Sdirk2

CASES = {
    "put": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
    "put with r < q": (Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.3, 0.07)),
    "call": (Option("call", 100.0, 1.0), Market(100.0, 0.03, 0.3, 0.07)),
    "put with two boundaries": (Option("put", 100.0, 1.0), Market(100.0, -0.005, 0.2, -0.05)),
    "call with two boundaries": (Option("call", 100.0, 1.0), Market(100.0, -0.05, 0.2, -0.005)),
}


@pytest.mark.parametrize("h", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("stretching", [0.0, 2.0])
@pytest.mark.parametrize("method", [ImplicitEuler, Sdirk2])
@pytest.mark.parametrize("case", CASES)
def test_the_tridiagonal_step_equals_the_general_lcs_step(case, method, stretching, h):
    """(11.65) for the system (11.63), solved as an LCP for u by the general library, three steps in a row."""
    option, market = CASES[case]
    domain = exercise_domain(option, market, 1e-8)
    form = ValueForm.discretise(option, market, domain, make_grid(domain, 60, stretching))
    system, x = form.as_lcs()
    unknowns = form.grid.interior.size
    general = LCSState(x, np.zeros(unknowns), np.zeros(unknowns))
    fast = start_state(form)
    general_method, fast_method = method(LCSStage(system)), method(TridiagonalStage(form))
    for k in range(3):
        general = general_method.step(k * h, general, h).state
        fast = fast_method.step(k * h, fast, h).state
    # The general system carries the exponentials of a deep option's end value as states, with their own O(h) error.
    exact_ends = system.shape[0] == unknowns + 1
    assert fast.value[0] == pytest.approx(general.value[:unknowns], abs=1e-10 if exact_ends else 1e-5)
    assert fast.multiplier == pytest.approx(general.multiplier, abs=1e-8 if exact_ends else 1e-4)
    assert np.max(fast.multiplier) > 1e-3
    assert fast.residual < 1e-12


@pytest.mark.parametrize("case", CASES)
def test_complementarity_holds_after_a_step(case):
    option, market = CASES[case]
    domain = exercise_domain(option, market, 1e-8)
    form = ValueForm.discretise(option, market, domain, make_grid(domain, 200))
    state = Sdirk2(TridiagonalStage(form)).step(0.0, start_state(form), 1e-2).state
    assert np.all(state.slack >= 0)
    assert np.all(state.multiplier >= 0)
    assert np.max(state.slack * state.multiplier) < 1e-12
    assert state.contact.any()


@pytest.mark.parametrize("form_class", [ValueForm, PremiumForm])
@pytest.mark.parametrize("lcp_method", ["policy", "psor", "lemke"])
@pytest.mark.parametrize("case", CASES)
def test_every_lcp_method_takes_the_same_steps(case, lcp_method, form_class):
    option, market = CASES[case]
    domain = exercise_domain(option, market, 1e-8)
    form = form_class.discretise(option, market, domain, make_grid(domain, 60))
    expected = found = start_state(form)
    for k in range(3):
        expected = Sdirk2(TridiagonalStage(form)).step(0.01 * k, expected, 0.01).state
        found = Sdirk2(TridiagonalStage(form, lcp_method)).step(0.01 * k, found, 0.01).state
        assert found.value == pytest.approx(expected.value, abs=1e-12)
        assert found.residual < 1e-13


@pytest.mark.parametrize("lcp_method", ["tridiagonal", "policy"])
def test_an_exercise_region_with_a_hole_is_found_from_any_start(lcp_method):
    option, market = CASES["put"]
    domain = exercise_domain(option, market, 1e-8)
    form = ValueForm.discretise(option, market, domain, make_grid(domain, 200))
    h, nodes = 1e-3, form.grid.interior
    base = form.payoff[None, 1:-1] + 0.05 * np.exp(-(((nodes + 0.2) / 0.03) ** 2))  # held around S = 82
    expected = TridiagonalStage(form, "lemke").solve(h, base, h, start_state(form))
    assert np.count_nonzero(np.diff(expected.contact)) == 3  # exercised, held, exercised, held
    for near in (start_state(form), expected):
        found = TridiagonalStage(form, lcp_method).solve(h, base, h, near)
        assert found.value == pytest.approx(expected.value, abs=1e-12)
        assert found.multiplier == pytest.approx(expected.multiplier, abs=1e-9)
        assert found.residual < 1e-14
        np.testing.assert_array_equal(found.contact, expected.contact)
