"""Switches carry charge and flux over, and act at the instants that closed forms give."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcs import EventDriven, pulses
from pricing_core.models import Characteristic, DiodeCircuit, PiecewiseConstant, Pulse, Sine

ONCE = PiecewiseConstant([1.0, 9.0], [0, 1])  # closes at t = 1
OPENS = PiecewiseConstant([1.0, 9.0], [1, 0])


@pytest.mark.parametrize("seed", range(8))
def test_capacitors_that_switches_join_keep_their_charge(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    farads, volts = rng.uniform(0.1, 3.0, n), rng.normal(0.0, 5.0, n)
    circuit = DiodeCircuit()
    for i in range(n):
        circuit.capacitor(f"C{i}", f"n{i}", "0", farads[i], volts[i])
    groups = rng.integers(0, 2, n)
    for i in range(n):
        others = [j for j in range(i) if groups[j] == groups[i]]
        if others:
            circuit.switch(f"S{i}", f"n{i}", f"n{rng.choice(others)}", ONCE)
    if not any(groups[i] == groups[j] for i in range(n) for j in range(i)):
        circuit.switch("S", "n0", "n1", OPENS)
    run = circuit.simulate((0.0, 2.0))
    for group in set(groups.tolist()):
        inside = groups == group
        shared = float(farads[inside] @ volts[inside] / farads[inside].sum())
        for i in np.flatnonzero(inside).tolist():
            expected = shared if inside.sum() > 1 else volts[i]
            assert run.voltage(f"n{i}")[-1] == pytest.approx(expected, abs=1e-12 * np.abs(volts).max())
    jumps = [event for event in run.events if event.kind == "jump"]
    for event in jumps:
        assert farads @ event.x_after == pytest.approx(farads @ event.x_before, abs=1e-12 * farads.sum() * 20)
        energy = 0.5 * farads @ (event.x_before**2 - event.x_after**2)
        assert event.energy_lost == pytest.approx(energy, abs=1e-11 * farads.sum() * 100)
        assert event.energy_lost >= 0.0


@pytest.mark.parametrize("seed", range(4))
def test_inductors_in_series_after_a_switch_opens_keep_their_flux(seed):
    henries, amperes = np.random.default_rng(seed).uniform(0.5, 3.0, (2, 3))
    circuit = DiodeCircuit()
    for i in range(3):
        circuit.inductor(f"L{i}", f"n{i}", f"n{i + 1}", henries[i], amperes[i])
        if i < 2:
            circuit.switch(f"S{i}", f"n{i + 1}", "0", OPENS)
    circuit.switch("S", "n0", "0", PiecewiseConstant([50.0, 60.0], [1, 0])).resistor("R", "n3", "0", 1e-9)
    event = next(event for event in circuit.simulate((0.0, 2.0)).events if event.kind == "jump")
    assert event.x_after == pytest.approx(np.full(3, henries @ event.x_before / henries.sum()), rel=1e-12)


def test_an_ideal_switch_is_the_limit_of_one_with_little_resistance():
    errors = []
    for ohms in (0.0, 1e-4, 1e-5):
        circuit = DiodeCircuit().capacitor("C1", "a", "0", 2, initial_voltage=3).capacitor("C2", "b", "0", 1)
        circuit.switch("S1", "a", "b", ONCE, resistance=ohms).resistor("R1", "b", "0", 5)
        errors.append(circuit.simulate((0.0, 3.0)).voltage("b")[-1] - 2.0 * math.exp(-2.0 / 15.0))
    assert errors[0] == pytest.approx(0.0, abs=1e-13)
    assert errors[1] / errors[2] == pytest.approx(10.0, rel=1e-3)


def test_a_switch_with_hysteresis_acts_where_the_voltage_reaches_its_thresholds():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 10).resistor("R1", "in", "a", 1000)
    circuit.capacitor("C1", "a", "0", 1e-6).switch("S1", "a", "0", ("a", "0", 5, 1), resistance=100)
    run = circuit.simulate((0.0, 5e-3))
    slow, fast, low = 1e-3, 1e-3 / 11.0, 10.0 / 11.0
    up, down = slow * math.log((10 - 4) / (10 - 6)), fast * math.log((6 - low) / (4 - low))
    first = slow * math.log(10 / (10 - 6))
    times = [first + (i // 2) * (up + down) + (i % 2) * down for i in range(len(run.events))]
    assert len(times) > 15
    assert [event.time for event in run.events] == pytest.approx(times, rel=1e-12)
    levels = [6.0, 4.0] * len(run.events)
    assert [event.x_before[0] for event in run.events] == pytest.approx(levels[: len(run.events)], rel=1e-12)
    closed = run.circuit.closed(run.trajectory)["S1"]
    assert not closed[run.t < 0.999 * first].any()
    assert closed[(run.t > 1.001 * first) & (run.t < 0.999 * (first + down))].all()


def test_a_relay_that_a_gate_pulse_drives_is_one_that_the_clock_drives():
    def converter(by_clock: bool) -> DiodeCircuit:
        gate = pulses(0.0, 5.0, period=1e-5, width=4e-6, rise=1e-7, fall=1e-7)
        circuit = DiodeCircuit().voltage_source("V1", "in", "0", 12).voltage_source("VG", "g", "0", gate)
        # 2.5 V is passed half-way through the ramps.
        control = Pulse(1e-5, 4.1e-6, 5e-8) if by_clock else ("g", "0", 2.5, 0)
        circuit.switch("S1", "in", "x", control).diode("D1", "0", "x").inductor("L1", "x", "out", 1e-4)
        return circuit.capacitor("C1", "out", "0", 1e-5).resistor("R1", "out", "0", 3)

    t = np.linspace(0.0, 3e-4, 400)
    one, other = (converter(by_clock).simulate((0.0, 3e-4), t_eval=t) for by_clock in (True, False))
    assert other.voltage("out") == pytest.approx(one.voltage("out"), abs=1e-11)
    assert other.current("L1") == pytest.approx(one.current("L1"), abs=1e-11)


def test_complementary_pulses_never_overlap_by_rounding():
    period, width = 1e-5, 3.3e-6
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 12).resistor("R1", "x", "0", 1)
    circuit.switch("S1", "in", "x", Pulse(period, width))
    circuit.switch("S2", "x", "0", Pulse(period, period - width, delay=width - period))
    run = circuit.simulate((0.0, 2000 * period))
    assert set(run.circuit.positions) == {(True, False), (False, True)}
    assert run.mean("v(x)") == pytest.approx(12 * width / period, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_diodes_with_forward_voltage_and_resistance(seed):
    volts, drop, ohms, load = np.random.default_rng(seed).uniform([5, 0.2, 0.1, 1], [20, 1.0, 3.0, 50])
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(volts, 50.0))
    circuit.diode("D1", "in", "out", drop, ohms).resistor("R1", "out", "0", load)
    t = np.linspace(0.0, 0.04, 81)
    run = circuit.simulate((0.0, 0.04), t_eval=t)
    exact = np.maximum(volts * np.sin(100 * math.pi * t) - drop, 0.0) * load / (load + ohms)
    assert run.voltage("out") == pytest.approx(exact, abs=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_a_nonlinear_resistor_stays_on_its_curve(seed):
    rng = np.random.default_rng(seed)
    corners = np.column_stack([np.sort(rng.uniform(-8, 8, 4)), np.sort(rng.uniform(-1, 1, 4))])
    curve = Characteristic(corners, left_slope=rng.uniform(0.1, 1), right_slope=rng.uniform(0.1, 1))
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(15.0, 50.0)).resistor("R1", "in", "a", 4)
    run = circuit.nonlinear_resistor("N1", "a", "0", curve).simulate(
        (0.0, 0.02), t_eval=np.linspace(0, 0.02, 41)
    )
    for supply, v, i in zip(run.voltage("in"), run.voltage("a"), run.current("N1"), strict=True):
        found = brentq(lambda v, e=supply: (e - v) / 4.0 - curve(v).item(), -20.0, 20.0, xtol=1e-13)
        assert (v, i) == pytest.approx((found, curve(found).item()), abs=1e-9)


def test_a_zener_without_resistance_holds_its_voltage():
    zener = Characteristic([(-5, 0), (0, 0)], left_slope=math.inf, right_slope=math.inf)
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(20.0, 50.0)).resistor("R1", "in", "a", 7)
    t = np.linspace(0.0, 0.02, 101)
    run = circuit.nonlinear_resistor("Z1", "0", "a", zener).simulate((0.0, 0.02), t_eval=t)
    assert run.voltage("a") == pytest.approx(np.clip(20 * np.sin(100 * math.pi * t), 0.0, 5.0), abs=1e-10)


def test_a_switch_that_its_own_voltage_turns_on_and_off_is_an_error():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 10).resistor("R1", "in", "a", 1000)
    circuit.capacitor("C1", "a", "0", 1e-6).switch("S1", "a", "0", ("a", "0", 5, 0), resistance=100)
    with pytest.raises(
        IterationLimitError, match=r"S1 on and off without end at t = 0\.000693147.*hysteresis"
    ):
        circuit.simulate((0.0, 1e-3))


def test_more_periods_than_memory_holds_are_refused():
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", 5).switch("S1", "a", "b", Pulse(1e-9, 5e-10))
    with pytest.raises(InvalidInputError, match=r"t_span = .* no longer than 0.0002 s: 200000 periods of S1"):
        circuit.resistor("R1", "b", "0", 1).simulate((0.0, 1.0))


def test_shorted_sources_name_the_switches():
    circuit = DiodeCircuit().voltage_source("V1", "a", "0", 5).switch("S1", "a", "x", Pulse(1, 0.5))
    circuit.switch("S2", "x", "0", Pulse(1, 0.5, 0.2)).resistor("R", "x", "0", 1)
    with pytest.raises(InvalidInputError, match=r"sources with S1, S2 closed = 'V1': must be free"):
        circuit.simulate((0.0, 2.0))


def test_the_state_may_switch_no_more_often_than_allowed():
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 10).resistor("R1", "in", "a", 1000)
    circuit.capacitor("C1", "a", "0", 1e-6).switch("S1", "a", "0", ("a", "0", 5, 1), resistance=100)
    with pytest.raises(IterationLimitError, match=r"5 events by t = .*raise max_events"):
        circuit.simulate((0.0, 5e-3), method=EventDriven(max_events=5))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda c: c.switch("S1", "a", "0", 5), "control of S1 = 5: must be a Pulse"),
        (lambda c: c.switch("S1", "a", "0", PiecewiseConstant([1], [[2]])), "of values 0 and 1"),
        (lambda c: c.switch("S1", "a", "0", ("a", "a", 1, 0)), "control of S1 = 'a': must be two different"),
        (lambda c: c.switch("S1", "a", "0", ("a", "0", 1, -1)), "hysteresis of S1 = -1: must be 0 or"),
        (lambda c: c.switch("S1", "a", "0", Pulse(1, 0.5), -1), "resistance of S1 = -1: must be 0 or"),
        (lambda c: c.switch("S1", "a", "0", Pulse(1, 0.5), 2, 1), "off_resistance of S1 = 1: must be larger"),
        (lambda c: c.switch("S1", "a", "a", Pulse(1, 0.5)), "nodes of S1 = 'a': must be two different nodes"),
        (
            lambda c: c.switch("S1", "a", "0", Pulse(1, 1)),
            "width = 1.0: must be shorter than the period of 1 s",
        ),
        (lambda c: c.switch("S1", "a", "0", Pulse(0, 1)), "period = 0: must be a positive number"),
        (lambda c: c.diode("D1", "a", "0", -0.7), "forward_voltage of D1 = -0.7: must be 0 or a positive"),
        (lambda c: c.nonlinear_resistor("N1", "a", "0", 3), "characteristic of N1 = int: must be a Charact"),
        (
            lambda c: c.switch("S1", "a", "0", ("q", "0", 1, 0)).simulate((0, 1)),
            "control of S1.*a node of the",
        ),
        (lambda c: c.switch("S1", "a", "0", Pulse(1, 0.5)).to_lcs(), "closed is missing: give those of"),
        (lambda c: c.to_lcs(closed=["S7"]), "closed = 'S7': must be a switch: there is none"),
        (
            lambda c: c.switch("S1", "a", "0", Pulse(1, 0.5)).simulate((0, 1), method="time-stepping"),
            "method = 'time-stepping': must be \"event-driven\" for a circuit with switches",
        ),
    ],
)
def test_what_is_no_switch_is_refused(build, message):
    with pytest.raises(InvalidInputError, match=message):
        build(DiodeCircuit().resistor("R", "a", "0", 1))


@pytest.mark.parametrize("seed", range(12))
def test_random_circuits_with_switches_obey_kirchhoff_and_their_diodes(seed):
    rng, period = np.random.default_rng(seed), 1e-5
    circuit = DiodeCircuit().voltage_source("V", "n0", "0", Sine(10, 2e4, offset=5) if seed % 2 else 12)
    nodes = ["0", "n0", "n1", "n2", "n3"]
    for node in nodes[2:]:
        circuit.resistor(f"R{node}", node, "0", rng.uniform(1, 100))
    for j in range(int(rng.integers(5, 10))):
        a, b = (nodes[i] for i in rng.choice(len(nodes), 2, replace=False))
        kind = rng.integers(0, 4)
        if kind == 0:
            circuit.capacitor(f"C{j}", a, b, rng.uniform(1e-7, 1e-5), rng.normal())
        elif kind == 1:
            circuit.inductor(f"L{j}", a, b, rng.uniform(1e-5, 1e-3))
        elif kind == 2:
            circuit.diode(f"D{j}", a, b, rng.choice([0.0, 0.7]), rng.uniform(0.01, 1))
        else:
            clock = Pulse(period, rng.uniform(0.1, 0.9) * period, rng.uniform(0, 1) * period)
            circuit.switch(f"S{j}", a, b, clock, rng.uniform(0.01, 1), rng.choice([None, 1e6]))
    circuit.switch("S", "n1", "n2", Pulse(period, 0.5 * period), 0.1)
    run = circuit.simulate((0.0, 4 * period)).refined(400)
    largest = max(float(np.abs(values).max()) for values in run.currents.values())
    for node in nodes[1:]:
        out = sum(
            (1 if ends[0] == node else -1) * run.currents[name]
            for name, ends in run.ends.items()
            if node in ends
        )
        assert out == pytest.approx(0.0, abs=1e-10 * largest)
    closed = run.circuit.closed(run.trajectory)
    for element in circuit.elements:
        i, v = run.current(element.name), run.voltage(*run.ends[element.name])
        if element.name[0] == "D":
            left = element.forward_voltage + element.resistance * i - v
            assert min(i.min() / largest, left.min()) >= -1e-9
            assert np.abs(i * left).max() <= 1e-9 * largest
        elif element.name[0] == "S":
            on = closed[element.name]
            assert v[on] == pytest.approx(element.resistance * i[on], abs=1e-9)
            assert i[~on] == pytest.approx(v[~on] / (element.off_resistance or np.inf), abs=1e-9 * largest)
