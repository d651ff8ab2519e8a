import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pricing_core.errors import InfeasibleError, InvalidInputError, NonUniqueError
from pricing_core.lcs import LCS, TimeStepping, simulate, theorem_11_6
from pricing_core.models import (
    Characteristic,
    PiecewiseLinearSystem,
    RelaySystem,
    coulomb_friction,
    dead_zone,
    gain_schedule,
    ideal_diode,
    relay_step,
    resistor,
    saturation,
)


def steady(x):
    return pytest.approx(x, abs=1e-10)


def scalar(curve: Characteristic, a: float = 0.0, b: float = -1.0, d: float = 0.0) -> PiecewiseLinearSystem:
    return PiecewiseLinearSystem([[a]], [[b]], [[1]], [[d]], [curve])


def on_the_curves(system, run) -> float:
    return max(
        curve.distance(run.y[:, i], run.u[:, i]).max() for i, curve in enumerate(system.characteristics)
    )


def test_a_saturated_integrator_is_linear_and_then_exponential():
    times = np.linspace(0.0, 5.0, 21)
    run = scalar(saturation()).simulate([3.0], (0.0, 5.0), t_eval=times)
    assert run.x[:, 0] == pytest.approx(np.where(times < 2, 3 - times, np.exp(-(times - 2))), abs=1e-13)
    assert run.switches == ((pytest.approx(2.0, rel=1e-14), (2,), (1,)),)
    assert run.u[:, 0] == pytest.approx(np.minimum(run.x[:, 0], 1.0), abs=1e-13)


def test_a_dead_zone_is_drifted_through():
    """x' = 1 - dz(x), dz with width 1: x = t up to 1, then 2 - e^{-(t - 1)}."""
    system = PiecewiseLinearSystem([[0, 1], [0, 0]], [[-1], [0]], [[1, 0]], None, [dead_zone()])
    run = system.simulate([0.0, 1.0], (0.0, 3.0), t_eval=[0.5, 1.0, 3.0])
    assert run.x[:, 0] == steady([0.5, 1.0, 2 - math.exp(-2.0)])


def test_a_mass_on_a_spring_with_coulomb_friction_sticks():
    """q'' = -q - sgn q' from 5.3: three half swings, then rest at 0.7 (see the relay)."""
    system = PiecewiseLinearSystem([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], None, [coulomb_friction()])
    run = system.simulate([5.3, 0.0], (0.0, 12.0))
    assert run.x[-1] == steady([0.7, 0.0])
    assert run.switches[-1].time == pytest.approx(3 * math.pi, rel=1e-12)


def test_friction_jumps_where_the_mass_turns_at_once():
    """The chapter's example: at a standstill the friction force goes from one end of its interval to the other."""
    system = PiecewiseLinearSystem([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], None, [coulomb_friction()])
    run = system.simulate([0.0, 5.0], (0.0, 2.5))
    (switch,) = run.switches
    assert (switch.before, switch.after) == ((2,), (0,))
    before, after = run.u[run.t == switch.time][:, 0]
    assert (before, after) == steady((-1.0, 1.0))


def test_viscous_friction_adds_its_slope():
    """v' = -sgn v - v/2 from 2: v = 4 e^{-t/2} - 2 up to t = 2 ln 2, then rest."""
    run = scalar(coulomb_friction(1.0, 0.5), b=1.0).simulate([2.0], (0.0, 3.0), t_eval=[1.0, 3.0])
    assert run.x[:, 0] == steady([4 * math.exp(-0.5) - 2, 0.0])
    assert run.switches[0].time == pytest.approx(2 * math.log(2.0), rel=1e-12)


def test_a_tunnel_diode_latches_in_one_of_two_states():
    """v' = 1.15 - 0.4 v - i(v): the load line meets the curve three times, on its falling part unstably."""
    curve = resistor([1.0, 2.0], [1.0, 0.25], 1.0, 1.0)
    system = PiecewiseLinearSystem([[-0.4, 1.0], [0, 0]], [[-1], [0]], [[1, 0]], None, [curve])
    ends = [system.simulate([v, 1.15], (0.0, 60.0)).x[-1, 0] for v in (0.0, 1.3, 2.5)]
    rest = [1.15 / 1.4, (1.15 + 1.75) / 1.4]
    assert ends == pytest.approx([rest[0], rest[0], rest[1]], abs=1e-6)


def test_a_zener_diode_holds_its_voltage():
    """Vertical beyond a corner: v' = 2 - v - i, i = 0 below 1 V: v = 2 - 2 e^{-t} up to ln 2, then 1 V with i = 1."""
    zener = Characteristic([(1.0, 0.0)], left_slope=0.0, right_slope=math.inf)
    system = PiecewiseLinearSystem([[-1, 2], [0, 0]], [[-1], [0]], [[1, 0]], None, [zener])
    run = system.simulate([0.0, 1.0], (0.0, 2.0), t_eval=[0.5, 2.0])
    assert run.x[:, 0] == steady([2 - 2 * math.exp(-0.5), 1.0])
    assert run.u[:, 0] == steady([0.0, 1.0])
    assert run.switches[0].time == pytest.approx(math.log(2.0), rel=1e-12)


def test_a_scheduled_gain_changes_the_rate_of_decay():
    """x' = -(3 x - 2) beyond 1, x' = -x below."""
    run = scalar(gain_schedule([-1.0, 1.0], [3.0, 1.0, 3.0])).simulate([3.0], (0.0, 2.0), t_eval=[0.2, 2.0])
    turn = math.log(7.0) / 3.0  # x - 2/3 falls from 7/3 to 1/3
    assert run.x[:, 0] == steady([2 / 3 + 7 / 3 * math.exp(-0.6), math.exp(-(2.0 - turn))])


def test_ideal_diodes_are_the_complementarity_conditions():
    A, B, C = [[-1, 0.5], [0.2, -1]], np.eye(2), np.eye(2)
    system = PiecewiseLinearSystem(A, B, C, None, [ideal_diode(), ideal_diode()])
    times = np.linspace(0, 2, 9)
    run = system.simulate([1.0, -0.5], (0.0, 2.0), t_eval=times)
    plain = simulate(LCS(A, B, C), [1.0, -0.5], (0.0, 2.0), t_eval=times)
    assert run.x == steady(plain.x)
    assert run.u == steady(plain.u)


@pytest.mark.parametrize("form", ["input-output", "dae"])
def test_relays_are_piecewise_linear(form):
    """Relay, both of its forms, and characteristic: one trajectory, the same pieces."""
    system = RelaySystem(
        [[-0.2, 1], [-1, -0.3]], [[1, -0.5], [0.5, 1]], np.eye(2), lower=[-2, -1], upper=[1, 0.5]
    )
    times = np.linspace(0.0, 4.0, 41)
    relay = system.simulate([2.0, -1.0], (0.0, 4.0), form=form, t_eval=times)
    converted = system.to_piecewise_linear().simulate([2.0, -1.0], (0.0, 4.0), t_eval=times)
    assert converted.x == steady(relay.x)
    assert converted.u == steady(relay.u)
    assert converted.y == steady(relay.y)
    assert [s.after for s in converted.switches] == [s.after for s in relay.switches]
    assert [s.time for s in converted.switches] == pytest.approx([s.time for s in relay.switches], rel=1e-11)


def test_example_11_1_reaches_its_zeno_point_as_a_piecewise_linear_system():
    spiral = RelaySystem(np.zeros((2, 2)), [[1, -2], [2, 1]], np.eye(2)).to_piecewise_linear()
    run = spiral.simulate([3.0, 1.0], (0.0, 2.5))
    assert (run.events[-1].kind, run.events[-1].time) == ("zeno", pytest.approx(2.0, rel=1e-12))
    assert run.x[-1] == steady([0.0, 0.0])


def test_the_w_property_of_relays_is_theorem_11_6():
    rng = np.random.default_rng(3)
    for _ in range(20):
        B = rng.integers(-2, 4, (2, 2))
        relay = RelaySystem(-np.eye(2), B, np.eye(2))
        assert relay.to_piecewise_linear().w_property().status == theorem_11_6(*relay.given).status


def test_the_w_property_sees_slopes_against_feedthrough():
    """y = x + d u, u = sat y, x' = b u: 1 - d - b/s must be positive, as 1 is on the flat pieces."""
    assert scalar(saturation(), d=0.5).w_property().status == "holds"
    assert scalar(saturation(), d=1.0).w_property().status == "holds"
    assert scalar(saturation(), b=0.0, d=1.0).w_property().reason.endswith("vanishes")
    assert scalar(saturation(), b=1.0, d=1.0).w_property().status == "silent"
    assert "another sign" in scalar(saturation(), d=2.0).w_property().reason
    one = np.eye(13)
    assert PiecewiseLinearSystem(-one, one, one, None, [saturation()] * 13).w_property().status == "holds"
    assert (
        PiecewiseLinearSystem(-one, one + 1, one, None, [saturation()] * 13).w_property().status == "silent"
    )


def test_the_w_property_treats_decimals_as_it_treats_integers():
    """y = x + 1.2 u with the slopes 3 and 1/2: 1 - 3.6 and 1 - 0.6 differ in sign, so that y turns back at 0."""
    system = scalar(gain_schedule([0.0], [3.0, 0.5]), d=1.2)
    assert "another sign" in system.w_property().reason
    with pytest.raises(NonUniqueError):
        system.simulate([1.0], (0.0, 1.0))
    with pytest.raises(InfeasibleError):
        system.simulate([-1.0], (0.0, 1.0))


def test_the_w_property_of_many_characteristics_is_found_column_by_column():
    """Twelve loops with G = -1/(s + 1), and the same where one of them has the wrong sign."""
    one, curves = np.eye(12), [saturation()] * 12
    assert PiecewiseLinearSystem(-one, -one, one, None, curves).w_property().status == "holds"
    D = np.diag([2.0, *np.zeros(11)])
    assert "another sign" in PiecewiseLinearSystem(-one, -one, one, D, curves).w_property().reason


def test_a_corner_at_the_start_is_left_exactly():
    """y = C x + 0.3 u stands on the right corner of a dead zone at 0, where u = 0, and falls into it."""
    A, B, C = [[-1.1, 0.6], [-0.3, 1.9]], [[1.2], [-0.1]], [[-0.4, -0.7]]
    system = PiecewiseLinearSystem(A, B, C, [[0.3]], [dead_zone(0.4, 0.3)])
    x0 = np.linalg.lstsq(C, [0.4], rcond=None)[0]
    assert (np.array(C) @ A @ x0).item() > 0.0
    run = system.simulate(x0, (0.0, 0.1))
    slope = 0.3 / (1 - 0.3 * 0.3)  # u = slope (C x - 0.4)
    shifted = np.array(A) + slope * np.outer(B, C)
    exact = solve_ivp(
        lambda t, x: shifted @ x - slope * 0.4 * np.ravel(B), (0, 0.1), x0, rtol=1e-12, atol=1e-13
    )
    assert run.x[-1] == pytest.approx(exact.y[:, -1], abs=1e-11)


def test_a_loop_that_folds_back_has_several_continuations():
    system = scalar(saturation(), d=2.0)  # u = sat(x + 2 u): -1, between and 1 at x = 0
    with pytest.raises(NonUniqueError):
        system.simulate([0.0], (0.0, 1.0))


def test_a_curve_that_folds_back_in_y_is_followed():
    """y + 2 u increases along the curve although y does not, so that y = x - 2 u meets it once, with x = t - 6."""
    fold = Characteristic([(1.0, 1.0), (-1.0, 3.0)], left_slope=1.0, right_slope=1.0)
    system = PiecewiseLinearSystem([[0, 1], [0, 0]], [[0], [0]], [[1, 0]], [[-2.0]], [fold])
    assert system.w_property().status == "holds"
    run = system.simulate([-6.0, 1.0], (0.0, 13.0), t_eval=[3.0, 10.0, 13.0])
    assert run.u[:, 0] == steady([-1.0, 2.0, 11 / 3])
    assert run.y[:, 0] == steady([-1.0, 0.0, -1 / 3])
    assert [(switch.time, switch.after) for switch in run.switches] == [
        (pytest.approx(9.0), (1,)),
        (pytest.approx(11.0), (2,)),
    ]


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 100_000))
def test_random_increasing_characteristics_are_followed_exactly(seed):
    """Passive plants and increasing curves, u entering with minus: one solution, met by a Runge-Kutta method too."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    curves = []
    for _ in range(k):
        m = int(rng.integers(1, 4))
        y = np.cumsum(rng.uniform(0.2, 1.0, m)) - 1.0
        u = np.cumsum(rng.uniform(0.0, 1.0, m)) - 0.5
        curves.append(Characteristic(np.column_stack([y, u]), *rng.uniform(0.0, 2.0, 2)))
    J, C = rng.normal(size=(n, n)), rng.normal(size=(k, n))
    A = J - J.T - 0.3 * np.eye(n)
    system = PiecewiseLinearSystem(A, -C.T, C, None, curves)
    assert system.w_property().status == "holds"
    x0, times = 2.0 * rng.normal(size=n), np.linspace(0.0, 3.0, 31)
    run = system.simulate(x0, (0.0, 3.0), t_eval=times)
    assert on_the_curves(system, run) < 1e-9
    assert run.y == pytest.approx(run.x @ C.T, abs=1e-9)

    def rate(t, x):
        return A @ x - C.T @ [curve(value) for curve, value in zip(curves, C @ x, strict=True)]

    reference = solve_ivp(rate, (0.0, 3.0), x0, t_eval=times, rtol=1e-9, atol=1e-10, max_step=0.005)
    assert run.x == pytest.approx(reference.y.T, abs=1e-6)


def test_time_stepping_agrees():
    times = np.linspace(0.0, 3.0, 7)
    system = PiecewiseLinearSystem([[0, 1], [-1, -0.1]], [[0], [1]], [[0, 1]], None, [relay_step(-0.4, 0.2)])
    exact = system.simulate([1.0, 0.0], (0.0, 3.0), t_eval=times)
    stepped = system.simulate([1.0, 0.0], (0.0, 3.0), method=TimeStepping(step=1e-3), t_eval=times)
    assert stepped.x == pytest.approx(exact.x, abs=5e-3)
    assert on_the_curves(system, stepped) < 1e-9


@pytest.mark.parametrize(
    ("characteristics", "message"),
    [
        ([], "one for each of the 1 inputs"),
        ([saturation()] * 2, "2 of them"),
        (["saturation"], r"characteristics\[0\]"),
    ],
)
def test_bad_input_is_named(characteristics, message):
    with pytest.raises(InvalidInputError, match=message):
        PiecewiseLinearSystem([[0]], [[1]], [[1]], None, characteristics)
