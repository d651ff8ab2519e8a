"""Converters in their periodic steady state obey the laws of textbooks (Erickson and Maksimovic 2020, chapters 2-5)."""

import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, NotFoundError
from pricing_core.lcs import EventDriven
from pricing_core.models import DiodeCircuit, Pulse, Sine
from pricing_core.models.circuits.steady_state import PeriodMap
from pricing_core.models.circuits.switched_circuit import SwitchedCircuit

T = 1e-5


def buck(duty: float, ohms: float, volts: float = 12.0, farads: float = 1e-4) -> DiodeCircuit:
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", volts).diode("D1", "0", "x")
    circuit.switch("S1", "in", "x", Pulse(T, duty * T)).inductor("L1", "x", "out", 1e-4)
    return circuit.capacitor("C1", "out", "0", farads).resistor("R1", "out", "0", ohms)


def boost(duty: float, ohms: float, volts: float = 12.0) -> DiodeCircuit:
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", volts).inductor("L1", "in", "x", 1e-4)
    circuit.switch("S1", "x", "0", Pulse(T, duty * T)).diode("D1", "x", "out")
    return circuit.capacitor("C1", "out", "0", 1e-3).resistor("R1", "out", "0", ohms)


@pytest.mark.parametrize("duty", [0.2, 0.5, 0.8])
def test_a_buck_converter_in_continuous_mode(duty):
    steady = buck(duty, 2.0).steady_state()
    assert steady.run.mean("v(out)") == pytest.approx(12 * duty, rel=1e-11)
    assert steady.run.mean("i(L1)") == pytest.approx(6 * duty, rel=1e-11)
    ripple = 12 * (1 - duty) * duty * T / 1e-4
    assert steady.run.ripple("i(L1)") == pytest.approx(ripple, rel=1e-3)
    assert steady.run.ripple("v(out)") == pytest.approx(ripple * T / 8e-4, rel=1e-2)
    assert steady.efficiency(["R1"], ["V1"]) == pytest.approx(1.0, rel=1e-10)
    assert steady.is_stable
    assert steady.residual < 1e-11


@pytest.mark.parametrize(("duty", "ohms"), [(0.3, 150.0), (0.5, 300.0)])
def test_a_buck_converter_in_discontinuous_mode(duty, ohms):
    steady = buck(duty, ohms, farads=1e-2).steady_state()  # so large that its voltage is constant
    law = 2 / (1 + math.sqrt(1 + 8e-4 / (ohms * T) / duty**2))
    assert steady.run.mean("v(out)") == pytest.approx(12 * law, rel=1e-5)
    assert min(abs(steady.multipliers)) == pytest.approx(0.0, abs=1e-12)  # the current forgets each period
    assert steady.run.current("L1").min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("duty", [0.3, 0.6])
def test_a_boost_converter_in_both_modes(duty):
    steady = boost(duty, 10.0).steady_state()
    assert steady.run.mean("v(out)") == pytest.approx(12 / (1 - duty), rel=1e-3)
    assert steady.run.mean("i(L1)") == pytest.approx(steady.run.mean("v(out)") / 10 / (1 - duty), rel=1e-3)
    light = boost(duty, 2000.0).steady_state()
    law = (1 + math.sqrt(1 + 4 * duty**2 / (2e-4 / (2000 * T)))) / 2
    assert light.run.mean("v(out)") == pytest.approx(12 * law, rel=1e-4)


def test_losses_are_those_of_the_resistances():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 12)
    circuit.transistor("S1", "in", "x", Pulse(T, 0.4 * T), 0.05, 1)
    circuit.transistor("S2", "x", "0", Pulse(T, 0.6 * T, delay=-0.6 * T), 0.05, 1)
    circuit.inductor("L1", "x", "out", 1e-4).capacitor("C1", "out", "0", 1e-4).resistor("R1", "out", "0", 2)
    steady = circuit.steady_state()
    assert steady.run.mean("v(out)") == pytest.approx(12 * 0.4 * 2 / 2.05, rel=1e-10)
    load, lost = steady.run.rms("v(out)") ** 2 / 2, 0.05 * steady.run.rms("i(L1)") ** 2
    assert steady.efficiency(["R1"], ["V1"]) == pytest.approx(load / (load + lost), rel=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_all_powers_of_a_converter_with_losses_add_up_to_nothing(seed):
    rng = np.random.default_rng(seed)
    duty, ohms, drop, on, esr = rng.uniform([0.2, 2.0, 0.2, 0.01, 0.01], [0.7, 200.0, 0.8, 0.2, 0.2])
    circuit = (
        DiodeCircuit().voltage_source("V", "in", "0", 12).switch("S", "in", "x", Pulse(T, duty * T), on, 1e5)
    )
    circuit.diode("D", "0", "x", drop, 0.02).inductor("L", "x", "y", 1e-4).resistor("RL", "y", "out", esr)
    circuit.capacitor("C", "out", "e", 2e-5).resistor("RC", "e", "0", esr).resistor("R", "out", "0", ohms)
    run = circuit.steady_state().run
    powers = {name: run.power(name) for name in run.currents}
    assert sum(powers.values()) == pytest.approx(0.0, abs=1e-11 * -powers["V"])
    assert powers["C"] == pytest.approx(0.0, abs=1e-10 * -powers["V"])
    assert powers["L"] == pytest.approx(0.0, abs=1e-10 * -powers["V"])
    assert powers["R"] == pytest.approx(run.rms("v(out)") ** 2 / ohms, rel=1e-11)
    assert powers["D"] == pytest.approx(drop * run.mean("i(D)") + 0.02 * run.rms("i(D)") ** 2, rel=1e-10)


def test_the_steady_state_is_where_a_long_run_ends():
    circuit = buck(0.4, 40.0, farads=1e-5)
    steady = circuit.steady_state()
    long = circuit.simulate((0.0, 2000 * T), t_eval=[2000 * T])
    assert long.trajectory.x[0] == pytest.approx(steady.x0, abs=1e-9)


def test_a_rectifier_with_a_smoothing_capacitor():
    circuit = (
        DiodeCircuit().voltage_source("V1", "in", "0", Sine(10.0, 50.0)).diode("D1", "in", "out", 0.7, 0.1)
    )
    circuit = circuit.capacitor("C1", "out", "0", 1e-3).resistor("R1", "out", "0", 100)
    steady = circuit.steady_state()
    long = circuit.simulate((0.0, 2.0), t_eval=[2.0])
    assert steady.period == pytest.approx(0.02)
    assert steady.x0 == pytest.approx(long.voltage("out"), abs=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_the_derivative_of_the_period_map_is_that_of_differences(seed):
    rng = np.random.default_rng(seed)
    circuit = SwitchedCircuit(
        (buck if seed % 2 else boost)(rng.uniform(0.2, 0.7), rng.uniform(2, 300)).elements
    )
    s = np.array([rng.uniform(0.0, 2.0), rng.uniform(1.0, 11.0)])
    turn = PeriodMap(circuit, (0.0, T), EventDriven(), circuit.start_positions())
    exact, step = turn.derivative(*turn.run(s), s), 1e-5
    for j in range(2):
        ahead, behind = (turn.after(s + sign * step * np.eye(2)[j])[0] for sign in (1, -1))
        assert exact[:, j] == pytest.approx((ahead - behind) / (2 * step), abs=1e-7)


def test_a_hysteretic_control_has_its_derivative_too():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(1.0, 1000.0, offset=5.0))
    circuit.switch("S1", "in", "x", ("s", "0", 0, 0.2)).resistor("RX", "x", "0", 2).resistor(
        "R0", "x", "y", 1
    )
    circuit.inductor("L1", "y", "0", 1e-3).voltage_source("VS", "s", "0", Sine(1.0, 2000.0, 0.3))
    steady = circuit.steady_state()
    long = circuit.simulate((0.0, 0.05), t_eval=[0.05])
    assert steady.x0 == pytest.approx(long.trajectory.x[0], abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"period": -1.0}, "period = -1.0: must be a positive number of seconds"),
        ({"period": 1.5e-5}, "period = 1.5e-05: must be a whole number of periods"),
        ({"tolerance": 0.0}, "tolerance = 0.0: must be a number > 0"),
        ({"x0": [1.0]}, "x0"),
        ({"method": "time-stepping"}, "method"),
    ],
)
def test_what_no_period_can_be_asked_for_is_refused(arguments, message):
    with pytest.raises(InvalidInputError, match=message):
        buck(0.4, 2.0).steady_state(**arguments)


def test_what_accumulates_has_no_steady_state():
    circuit = buck(0.4, 2.0).inductor("L9", "in", "0", 1e-3)
    with pytest.raises(NotFoundError, match=r"period 1e-05 s: i\(L9\) keeps what it gains in a period"):
        circuit.steady_state()


def test_a_circuit_without_states_is_steady_at_once():
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", Sine(10, 50)).diode("D1", "a", "b")
    steady = circuit.resistor("R1", "b", "0", 5).steady_state()
    assert steady.x0.size == 0
    assert steady.run.mean("v(b)") == pytest.approx(10 / math.pi, rel=1e-12)


def test_a_circuit_without_a_clock_needs_a_period():
    with pytest.raises(InvalidInputError, match="period is missing: no source or control is periodic"):
        DiodeCircuit().resistor("R", "a", "0", 1).capacitor("C", "a", "0", 1).steady_state()
