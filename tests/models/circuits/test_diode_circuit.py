"""Circuits of the literature and of textbooks have their exact solutions."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models import DiodeCircuit, PiecewiseConstant, Sine
from tests.problems import circuits
from tests.problems.lcs_problems import diode_bridge as bridge_as_a_system


def near(values, tolerance: float = 1e-10):
    return pytest.approx(values, abs=tolerance)


def test_the_bridge_is_the_damped_oscillator_that_it_looks_like():
    problem = bridge_as_a_system()
    times = [*problem.times, 2e-3, 4.999e-3]
    run = circuits.diode_bridge().simulate((0.0, 5e-3), t_eval=times)
    exact = np.array([problem.exact(t) for t in times])
    assert run.voltage("a", "b") == near(exact[:, 0], 1e-9)
    assert run.current("L") == near(exact[:, 1], 1e-11)
    assert run.voltage("p") == near(np.abs(exact[:, 0]), 1e-9)
    assert run.current("R") == near(np.abs(exact[:, 0]) / 1e3, 1e-12)
    assert run.circuit.stored_energy.diagonal() == pytest.approx([1e-6, 1e-2])


def test_the_filtered_bridge_shares_its_charge_and_then_has_its_exact_values():
    times = [1e-6, 2e-6, 1e-4, 1e-3, 4.999e-3]
    run = circuits.filtered_bridge().simulate((0.0, 5e-3), t_eval=times)
    first = run.events[0]
    assert run.circuit.state_names == ("v(C)", "i(L)", "v(Cf)")
    assert first.kind == "jump"
    assert first.x_after == near([100 / 13, 0.0, 100 / 13])
    assert first.energy_lost == pytest.approx(5e-5 - 0.65e-6 * (100 / 13) ** 2, rel=1e-12)
    bridge = [7.686097103377391, 7.679300282877036, 4.096759706332225, -4.437266965, -0.196622956]
    assert run.voltage("a", "b") == near(bridge, 1e-9)
    assert run.voltage("p")[2:] == near([5.747070622528, 4.437266965, 0.421491734], 1e-9)
    assert run.current("L")[2] == near(0.0639902632531)


def test_two_capacitors_share_their_charge_through_a_diode():
    circuit = DiodeCircuit().capacitor("C1", "a", "0", 1, initial_voltage=3).capacitor("C2", "b", "0", 2)
    run = circuit.diode("D1", "a", "b").simulate((0.0, 1.0))
    assert run.events[0].x_after == near([1.0, 1.0])  # (C1 v1 + C2 v2)/(C1 + C2)
    assert run.events[0].impulse == near([2.0])
    assert run.events[0].energy_lost == pytest.approx(3.0)  # C1 C2 (v1 - v2)**2/(C1 + C2)/2


def test_a_half_wave_rectifier_passes_the_positive_half_waves():
    t = np.linspace(0.0, 0.06, 61)
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(10.0, 50.0)).diode("D1", "in", "out")
    run = circuit.resistor("R1", "out", "0", 5).simulate((0.0, 0.06), t_eval=t)
    assert run.voltage("out") == near(np.maximum(0.0, 10.0 * np.sin(100.0 * math.pi * t)), 1e-9)
    assert run.current("V1") == near(-run.current("R1"))
    assert [event.time for event in run.events if event.time > 0.0] == near(np.arange(1, 7) / 100)


def test_a_full_wave_rectifier_turns_the_negative_half_waves_over():
    t = np.linspace(0.0, 0.05, 51)
    circuit = DiodeCircuit().voltage_source("V1", "a", "b", Sine(10.0, 50.0))
    circuit.diode("D1", "a", "p").diode("D2", "b", "p").diode("D3", "0", "a").diode("D4", "0", "b")
    run = circuit.resistor("R1", "p", "0", 5).simulate((0.0, 0.05), t_eval=t)
    assert run.voltage("p") == near(np.abs(10.0 * np.sin(100.0 * math.pi * t)), 1e-9)


def test_a_centre_tap_and_two_diodes_do_the_same():
    t = np.linspace(0.0, 0.05, 51)
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(10.0, 50.0))
    circuit.transformer("X1", "in", "0", "a", "0", 2).transformer("X2", "in", "0", "0", "b", 2)
    circuit.diode("D1", "a", "p").diode("D2", "b", "p").resistor("R1", "p", "0", 5)
    run = circuit.simulate((0.0, 0.05), t_eval=t)
    assert run.voltage("p") == near(np.abs(5.0 * np.sin(100.0 * math.pi * t)), 1e-9)
    assert run.current("V1") == near(-np.sin(100.0 * math.pi * t) / 2, 1e-9)  # 1 A at the peak, over 2


def test_an_inductive_load_delays_the_extinction_of_a_rectifier():
    """i = (sin(t - phi) + sin(phi) exp(-t))/sqrt(2), phi = pi/4, until it is zero again."""
    end = brentq(lambda t: math.sin(t - math.pi / 4) + math.exp(-t) / math.sqrt(2), math.pi, 2 * math.pi)
    run = circuits.loaded_rectifier().simulate((0.0, 20.0), t_eval=[2.0, 5.0])
    switches = [end + 2 * math.pi * n for n in range(3)] + [2 * math.pi * n for n in (1, 2, 3)]
    assert [event.time for event in run.events if event.time > 0.0] == pytest.approx(
        sorted(switches), rel=1e-12
    )
    conducting = (math.sin(2.0 - math.pi / 4) + math.exp(-2.0) / math.sqrt(2)) / math.sqrt(2)
    assert run.current("L1") == near([conducting, 0.0])


def test_a_peak_detector_lets_go_where_its_load_draws_more_than_the_source_gives():
    """C v' + v/R = 0 at tan(w t) = -w R C; from there v decays until the source has risen to it."""
    w, tau = 100.0 * math.pi, 0.1
    release = (math.pi - math.atan(w * tau)) / w
    held = 10.0 * math.sin(w * release)
    catch = brentq(lambda t: 10.0 * math.sin(w * t) - held * math.exp((release - t) / tau), 0.021, 0.025)
    run = circuits.peak_detector().simulate((0.0, 0.04), t_eval=[0.015])
    times = [event.time for event in run.events if event.time > 0.0]
    assert times == pytest.approx([release, catch, release + 0.02], rel=1e-12)
    assert run.voltage("out") == near(held * math.exp((release - 0.015) / tau))


def test_a_doubler_halves_what_it_lacks_in_every_period():
    """At the n-th peak 20 V meet the capacitor: v -> (20 + v)/2, from 5 V at the first one."""
    periods = np.arange(12)
    run = circuits.voltage_multiplier().simulate((0.0, 0.24), t_eval=0.02 * periods + 0.01)
    assert run.voltage("d1") == near(20.0 - 15.0 / 2.0**periods)


def test_a_multiplier_of_three_stages_approaches_sixty_volts():
    run = circuits.voltage_multiplier(3).simulate((0.0, 4.0), t_eval=[1.0, 2.0, 3.0, 4.0])
    assert np.all(np.diff(run.voltage("d3")) > 0.0)
    assert run.voltage("d3")[-1] == pytest.approx(60.0, abs=1e-3)


def test_resonant_charging_ends_at_twice_the_supply():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 5).diode("D1", "in", "a")
    circuit.inductor("L1", "a", "b", 1e-3).capacitor("C1", "b", "0", 1e-6)
    run = circuit.simulate((0.0, 3e-4), t_eval=[5e-5, 2e-4])
    w = 1.0 / math.sqrt(1e-9)
    assert run.voltage("b") == near([5.0 * (1.0 - math.cos(5e-5 * w)), 10.0])
    assert run.events[-1].time == pytest.approx(math.pi / w, rel=1e-12)


def test_a_resonant_converter_swings_by_half_waves_about_the_difference_of_supply_and_load():
    """With L = C = 1 the capacitor goes in time pi from v to 2 (s E - s' U) - v, s' the sign of the current.

    E = 12, U = 7: from 0 to 10, where 2 V drive nothing; after the step at 4 to -20, and back to -18.
    """
    run = circuits.resonant_converter().simulate(
        (0.0, 16.0), t_eval=[1.0, 3.9, 4.0 + math.pi, 7.9, 8.0, 11.5]
    )
    first = [5.0 * (1.0 - math.cos(1.0)), 10.0, -20.0]
    assert run.voltage("m", "a")[:3] == near(first)
    # From 4 + pi on about -19, so after 3.9 - pi there it is
    assert run.voltage("m", "a")[3] == near(-19.0 - math.cos(3.9 - math.pi))
    current = math.sin(3.9 - math.pi)
    assert run.current("L1")[3] == near(current)
    assert run.current("VL")[3] == near(current)
    # At 8 the supply steps to +12 with the current still on: about +5 from there
    v, i = -19.0 - math.cos(4.0 - math.pi), math.sin(4.0 - math.pi)
    assert run.voltage("m", "a")[4] == near(v)
    arrival = 8.0 + math.pi - math.atan2(i, 5.0 - v)
    assert any(event.time == near(arrival) for event in run.events)
    peak = 5.0 + math.hypot(v - 5.0, i)
    # There 12 - peak < -7: it swings back about 19
    assert run.voltage("m", "a")[5] == near(19.0 + (peak - 19.0) * math.cos(11.5 - arrival))


def test_controlled_sources_amplify():
    """A third of 3 V, ten times that through a diode, and on by the current of 2.5 A, by 5 V, and by 2.5 A again."""
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 3).resistor("R1", "in", "a", 1000)
    circuit.resistor("R2", "a", "0", 500).vcvs("E1", "b", "0", "a", "0", 10).diode("D1", "b", "c")
    circuit.resistor("R3", "c", "0", 4).cccs("F1", "0", "d", "R3", 2).resistor("R4", "d", "0", 1)
    circuit.vccs("G1", "0", "e", "d", "0", 0.5).resistor("R5", "e", "0", 2).ccvs("H1", "f", "0", "R5", 3)
    run = circuit.resistor("R6", "f", "0", 1).simulate((0.0, 1.0), t_eval=[0.5])
    values = [run.voltage(node)[0] for node in "abcdef"]
    assert values == near([1.0, 10.0, 10.0, 5.0, 5.0, 7.5])


def test_coupled_inductors_transform():
    """A current step in the first: v2 = M i1' with M = k sqrt(L1 L2), here 1/2 sqrt(4) = 1."""
    circuit = DiodeCircuit().current_source("I1", "0", "a", piecewise_linear([0.0, 10.0], [0.0, 10.0]))
    circuit.inductor("L1", "a", "0", 1).inductor("L2", "b", "0", 4).coupling("K1", "L1", "L2", 0.5)
    run = circuit.resistor("R1", "b", "0", 100).simulate((0.0, 10.0), t_eval=[5.0])
    assert run.voltage("b") == near([1.0 * (1.0 - math.exp(-5.0 * 100.0 / 4.0))])
    assert run.circuit.state_names == ("i(L2) + 0.25 I1",)
    assert run.circuit.is_passive


def test_a_start_can_be_given_in_the_order_of_the_state_names():
    run = circuits.diode_bridge().simulate((0.0, 1e-6), [5.0, 0.0], t_eval=[0.0])
    assert run.voltage("a", "b") == near([5.0])


def test_antiparallel_diodes_are_a_short():
    """v(a) = 0, 3 i' = V1 in L1, and -(2 V1' + i) is the difference of the diodes' currents, of which one is zero."""
    circuit = DiodeCircuit.from_netlist("""
        V1 b 0 SIN(.25 1 1)
        C1 a b 2 IC=-.25
        D2 0 a
        D3 a 0
        L1 b a 3 IC=1
    """)
    t, w = np.linspace(0.0, 3.0, 61), 2.0 * math.pi
    run = circuit.simulate((0.0, 3.0), t_eval=t)
    inductor = 1.0 + (0.25 * t + (1.0 - np.cos(w * t)) / w) / 3.0
    shorted = -2.0 * w * np.cos(w * t) - inductor
    assert run.voltage("a") == near(np.zeros(61))
    assert run.current("L1") == near(inductor)
    assert run.current("D2") == near(np.maximum(shorted, 0.0))
    assert run.current("D3") == near(np.maximum(-shorted, 0.0))


def test_stepping_gives_the_same_voltages():
    run = circuits.diode_bridge().simulate((0.0, 1e-3), method="time-stepping", t_eval=[1e-4])
    assert run.voltage("a", "b") == pytest.approx([4.7491270988256735], rel=1e-2)


def test_names_that_the_run_does_not_know_are_refused():
    run = circuits.diode_bridge().simulate((0.0, 1e-4))
    with pytest.raises(InvalidInputError, match="node = 'z'"):
        run.voltage("z")
    with pytest.raises(InvalidInputError, match="element = 'Z'"):
        run.current("Z")


@pytest.mark.parametrize("method", ["event-driven", "time-stepping"])
def test_no_times_give_no_values(method):
    run = circuits.diode_bridge().simulate((0.0, 1e-4), method=method, t_eval=[])
    assert (run.t.shape, run.voltage("a").shape, run.current("R").shape) == ((0,), (0,), (0,))
    with pytest.raises(InvalidInputError, match=r"node = \['a'\]: must be a string"):
        run.voltage(["a"])


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, np.uint8, np.longdouble])
def test_numbers_may_be_of_numpy(kind):
    def charged(five, source):
        circuit = DiodeCircuit().voltage_source("V1", "in", "0", source).resistor("R1", "in", "a", five)
        return circuit.capacitor("C1", "a", "0", five, initial_voltage=five).diode("D1", "0", "a")

    for source in (kind(5), Sine(kind(5), kind(5))):
        circuit = charged(kind(5), source)
        assert type(circuit.elements[1].ohms) in (int, float)
        assert circuit.to_lcs().system.A.item() == -0.04


def test_a_name_is_given_once():
    with pytest.raises(InvalidInputError, match="used by one element only"):
        DiodeCircuit().diode("D1", "a", "0").diode("D1", "b", "0")


def test_a_source_that_steps_is_read_before_and_after():
    step = PiecewiseConstant([1.0, 2.0], [1.0, 3.0])
    run = DiodeCircuit().voltage_source("V1", "a", "0", step).resistor("R1", "a", "0", 1).simulate((0.0, 2.0))
    at_the_step = run.voltage("a")[run.t == 1.0]
    assert (at_the_step[0], at_the_step[-1]) == (1.0, 3.0)
