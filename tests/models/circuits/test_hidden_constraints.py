"""Capacitor loops and inductor cut-sets are reduced to independent states, which stay continuous."""

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import piecewise_linear
from pricing_core.models import DiodeCircuit, PiecewiseConstant, Sine


def test_a_loop_of_three_capacitors_has_two_states():
    circuit = DiodeCircuit().capacitor("C1", "a", "0", 1, 6).capacitor("C2", "b", "0", 2)
    run = circuit.capacitor("C3", "a", "b", 3).resistor("R1", "b", "0", 1).simulate((0.0, 1.0), t_eval=[0.0])
    assert run.circuit.state_names == ("v(C1)", "v(C2)")
    # Charges (C1 + C3) a - C3 b = 6 at one node and (C2 + C3) b - C3 a = 0 at the other
    a, b = np.linalg.solve([[4.0, -3.0], [-3.0, 5.0]], [6.0, 0.0])
    assert run.voltage("a") == pytest.approx([a])
    assert run.voltage("b") == pytest.approx([b])
    left = 0.5 * (a**2 + 2 * b**2 + 3 * (a - b) ** 2)
    assert run.energy_lost_at_start == pytest.approx(18.0 - left)


def test_inductors_in_series_share_their_flux():
    circuit = (
        DiodeCircuit().inductor("L1", "0", "a", 1, 6).inductor("L2", "a", "b", 2).resistor("R1", "b", "0", 3)
    )
    run = circuit.simulate((0.0, 1.0), t_eval=[0.0, 1.0])
    assert run.circuit.state_names == ("i(L1)",)
    assert run.current("R1") == pytest.approx([2.0, 2.0 * np.exp(-1.0)])
    assert run.voltage("a") == pytest.approx(run.voltage("b") * 1 / 3)
    assert run.energy_lost_at_start == pytest.approx(18.0 - 6.0)


def test_a_capacitive_divider_follows_the_steps_of_its_source():
    step = PiecewiseConstant([1.0, 2.0], [0.0, 8.0])
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", step).capacitor("C1", "in", "out", 1)
    run = (
        circuit.capacitor("C2", "out", "0", 3)
        .resistor("R1", "out", "0", 1)
        .simulate((0.0, 5.0), t_eval=[0.5, 1, 5])
    )
    assert run.circuit.state_names == ("v(C1) - 0.75 V1",)
    assert run.voltage("out") == pytest.approx([0.0, 2.0, 2.0 * np.exp(-1.0)])  # after 4 s, R (C1 + C2) = 4 s
    (event,) = run.events
    assert event.kind == "input"
    assert event.energy_lost == pytest.approx(
        0.5 * 0.75 * 64.0
    )  # a series capacitance of 3/4 F charged to 8 V


def test_a_capacitor_across_a_source_takes_the_current_of_its_derivative():
    t = np.linspace(0.0, 6.0, 7)
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", Sine(2.0, 0.125, phase=0.3))
    run = circuit.capacitor("C1", "a", "0", 5).simulate((0.0, 6.0), t_eval=t)
    w = np.pi / 4
    assert run.current("C1") == pytest.approx(5 * 2 * w * np.cos(w * t + 0.3))
    assert run.circuit.state_names == ()


def test_an_inductor_in_series_with_a_current_source_has_the_voltage_of_its_derivative():
    ramp = piecewise_linear([0.0, 2.0, 3.0], [0.0, 6.0, 0.0])
    circuit = DiodeCircuit().current_source("I1", "0", "a", ramp).inductor("L1", "a", "0", 0.5)
    run = circuit.simulate((0.0, 4.0), t_eval=[1.0, 2.5, 3.5])
    assert run.voltage("a") == pytest.approx([1.5, -3.0, 0.0])


def test_a_controlled_source_may_differentiate_what_a_diode_sees():
    """i(C1) = v1', and 2 ohms times that drives the diode and its load."""
    ramp = piecewise_linear([0.0, 1.0, 2.0], [0.0, 3.0, 0.0])
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", ramp).capacitor("C1", "a", "0", 1)
    circuit.ccvs("H1", "b", "0", "C1", 2).diode("D1", "b", "c").resistor("R1", "c", "0", 1)
    run = circuit.simulate((0.0, 3.0), t_eval=[0.5, 1.5, 2.5])
    assert run.voltage("c") == pytest.approx([6.0, 0.0, 0.0])
    steps = DiodeCircuit()
    for element in circuit.elements[1:]:
        steps.add(element)
    with pytest.raises(InvalidInputError, match=r"source = V1: must be continuous.*piecewise linear"):
        steps.voltage_source("V1", "a", "0", PiecewiseConstant([1.0, 2.0], [0.0, 1.0])).to_lcs()


def test_a_second_derivative_is_found_through_two_controlled_sources():
    """The current into C1 is v1'; copied into a voltage across C2 it is differentiated again."""
    circuit = (
        DiodeCircuit().voltage_source("V1", "a", "0", Sine(1.0, 0.5 / np.pi)).capacitor("C1", "a", "0", 1)
    )
    circuit.ccvs("H1", "b", "0", "C1", 1).capacitor("C2", "b", "0", 1)
    run = circuit.simulate((0.0, 3.0), t_eval=[1.0, 2.0])
    assert run.voltage("b") == pytest.approx(np.cos([1.0, 2.0]))
    assert run.current("C2") == pytest.approx(-np.sin([1.0, 2.0]))
