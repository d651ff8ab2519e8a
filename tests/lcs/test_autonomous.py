import numpy as np
import pytest

from pricing_core.lcs import LCS, Exosystem, simulate, sine
from pricing_core.lcs.autonomous import autonomous_form


def driven(f: Exosystem, g: Exosystem) -> LCS:
    return LCS([[-1.0]], [[1.0]], [[1.0]], [[1.0]], f=f, g=g)


def inputs(form, w):
    """Return f and g as the form sees them in its own units, in those that were given."""
    units = form.units
    f = form.system.A @ (w / units.state) * units.rate * units.state
    g = form.system.C @ (w / units.state) / units.pair
    return f[0], g[0]


def test_inputs_of_one_exosystem_share_its_states():
    f, g = sine(2.0, frequency=1.0), sine(3.0, frequency=1.0)
    form = autonomous_form(driven(f, g))
    assert form.system.shape == (4, 1)
    w = form.state_after(np.zeros(1), 0.1)
    assert inputs(form, w) == pytest.approx((f.after(0.1)[0], g.after(0.1)[0]))


def test_inputs_of_two_exosystems_keep_their_own_states():
    f, g = sine(2.0, frequency=1.0), sine(3.0, frequency=1.0, phase=0.5)
    form = autonomous_form(driven(f, g))
    assert form.system.shape == (7, 1)
    w = form.state_after(np.zeros(1), 0.1)
    assert inputs(form, w) == pytest.approx((f.after(0.1)[0], g.after(0.1)[0]))


def test_sharing_states_changes_no_trajectory():
    def run(second: Exosystem) -> np.ndarray:
        return simulate(driven(sine(2.0, frequency=1.0), second), [0.0], (0.0, 3.0), t_eval=[1.0, 2.5]).x

    g = sine(3.0, frequency=1.0)
    later = Exosystem(g.generator, g.output, [g.states[0], g.state_after(1.0)], [0.0, 1.0])
    assert run(g) == pytest.approx(run(later), rel=1e-12)
