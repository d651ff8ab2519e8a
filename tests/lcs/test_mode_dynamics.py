import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from pricing_core.lcs import initial_solution, mode_geometry, rational_complementarity
from pricing_core.lcs.autonomous import autonomous_form
from pricing_core.lcs.mode_dynamics import State, mode_dynamics
from pricing_core.lcs.modes import all_modes
from tests.problems.lcs_systems import bridge, integrators, random_system, two_carts


@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3), st.booleans())
@settings(max_examples=100, deadline=None)
def test_the_modes_that_admit_a_state_are_those_of_the_exact_problem(seed, n, k, feedthrough):
    rng = np.random.default_rng(seed)
    system, x0 = random_system(rng, n, k, feedthrough=feedthrough), rng.integers(-3, 4, n)
    form = autonomous_form(system)
    z = x0 / form.units.state
    exact = rational_complementarity(system, x0).solution_sets
    for mode in all_modes(k):
        dynamics = mode_dynamics(form, mode)
        if dynamics is not None:
            entry = dynamics.entered(State(z, np.full(z.size, np.abs(z).max(initial=0.0))))
            assert (entry is not None) == (mode in exact)


def test_a_mode_in_which_the_input_is_open_has_no_dynamics():
    form = autonomous_form(bridge())
    assert mode_dynamics(form, (0, 1)) is None
    assert mode_dynamics(form, (0, 2)) is not None


@pytest.mark.parametrize("mode", [(0,), (1,), (0, 1)])
def test_flow_and_jump_are_those_of_the_geometry(mode):
    system = two_carts()
    form, geometry = autonomous_form(system), mode_geometry(system, mode)
    dynamics = mode_dynamics(form, mode)
    x = np.array([0.3, -0.2, -2.0, 1.0])
    z = x / form.units.state
    c = dynamics.enter(State(z, np.abs(z))).z
    landed = dynamics.basis @ c * form.units.state
    assert landed == pytest.approx(geometry.projection @ x, abs=1e-13)
    t = min(0.8 * dynamics.step / form.units.rate, 1.0)
    place = t * form.units.rate / dynamics.step
    closed = system.A + system.B[:, list(mode)] @ geometry.feedback
    flown = dynamics.flowed(c[None], np.array([place]))[0]
    assert dynamics.basis @ flown * form.units.state == pytest.approx(expm(closed * t) @ landed, abs=1e-12)


@pytest.mark.parametrize(
    ("degree", "start"), [(2, [0.0, -1.0]), (3, [0.0, -1.0, 0.0]), (3, [0.0, -2.0, 3.0])]
)
def test_impulses_are_those_of_the_initial_solution(degree, start):
    system = integrators(degree)
    form = autonomous_form(system)
    dynamics = mode_dynamics(form, (0,))
    found = (dynamics.impulses @ (np.array(start) / form.units.state))[::-1, 0] * form.units.pair[0]
    found = found / form.units.rate ** np.arange(1, found.size + 1)
    exact = initial_solution(system, start).impulses[:, 0]
    assert found[: exact.size] == pytest.approx(exact, abs=1e-12)
    assert found[exact.size :] == pytest.approx(0.0, abs=1e-12)
