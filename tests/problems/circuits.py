"""Circuits with ideal diodes whose solutions are known in closed form."""

import math
from fractions import Fraction

from pricing_core.models import DiodeCircuit, PiecewiseConstant, Sine

UNIT_SINE = Sine(1.0, frequency=1.0 / (2.0 * math.pi))  # sin t


def diode_bridge() -> DiodeCircuit:
    """Four diodes that feed a resistor from an LC oscillator at 10 V (an example of the Siconos project)."""
    return (
        DiodeCircuit()
        .capacitor("C", "a", "b", Fraction(1, 10**6), initial_voltage=10)
        .inductor("L", "a", "b", Fraction(1, 100))
        .diode("D1", "a", "p")
        .diode("D2", "b", "p")
        .diode("D3", "0", "a")
        .diode("D4", "0", "b")
        .resistor("R", "p", "0", 1000)
    )


def filtered_bridge() -> DiodeCircuit:
    """The bridge with an empty capacitor beside its resistor."""
    return diode_bridge().capacitor("Cf", "p", "0", Fraction(3, 10**7))


def loaded_rectifier() -> DiodeCircuit:
    """sin t through a diode into 1 ohm and 1 henry in series."""
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", UNIT_SINE).diode("D1", "in", "a")
    return circuit.resistor("R1", "a", "b", 1).inductor("L1", "b", "0", 1)


def peak_detector(ohms: float = 1e4, farads: float = 1e-5) -> DiodeCircuit:
    """10 V at 50 Hz through a diode into a capacitor and a resistor side by side."""
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", Sine(10.0, 50.0)).diode("D1", "in", "out")
    return circuit.capacitor("C1", "out", "0", farads).resistor("R1", "out", "0", ohms)


def voltage_multiplier(stages: int = 1) -> DiodeCircuit:
    """A Cockcroft-Walton ladder of equal capacitors: 10 V at 50 Hz towards 20 V a stage."""
    circuit = DiodeCircuit().voltage_source("V1", "a0", "0", Sine(10.0, 50.0))
    for i in range(stages):
        below = f"d{i}" if i else "0"
        circuit.capacitor(f"CA{i}", f"a{i}", f"a{i + 1}", 1e-6).diode(f"DA{i}", below, f"a{i + 1}")
        circuit.capacitor(f"CD{i}", below, f"d{i + 1}", 1e-6).diode(f"DD{i}", f"a{i + 1}", f"d{i + 1}")
    return circuit


def resonant_converter(supply: float = 12.0, load: float = 7.0, half_period: float = 4.0) -> DiodeCircuit:
    """A square wave of +-supply, 1 H and 1 F in series, a diode bridge, and a load of constant voltage."""
    wave = PiecewiseConstant([half_period, 2 * half_period, 9 * half_period], [supply, -supply, supply])
    return (
        DiodeCircuit()
        .voltage_source("V1", "s", "b", wave)
        .inductor("L1", "s", "m", 1)
        .capacitor("C1", "m", "a", 1)
        .diode("D1", "a", "p")
        .diode("D2", "b", "p")
        .diode("D3", "0", "a")
        .diode("D4", "0", "b")
        .voltage_source("VL", "p", "0", load)
    )
