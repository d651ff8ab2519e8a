"""Five DC-DC converters in their periodic steady state, each held against the laws of textbooks.

The laws are those of Erickson and Maksimovic, Fundamentals of Power Electronics (2020), chapters 2, 3 and 5. Some
follow from the mean voltage of an inductor, which is zero, and are exact; the others neglect the ripple of the output,
and hold to the larger tolerances that are printed.

Run it from the root of the project: .venv/bin/python examples/14_converters.py
"""

import math
from pathlib import Path

from matplotlib.figure import Figure

from pricing_core.models import DiodeCircuit, Pulse, SteadyState

T, VOLTS, DUTY = 10e-6, 12.0, 0.4  # 100 kHz, 12 V
ON = Pulse(T, DUTY * T)
OFF = Pulse(T, (1 - DUTY) * T, delay=(DUTY - 1) * T)  # while ON is not


def loaded(circuit: DiodeCircuit, ohms: float, farads: float = 1e-4) -> DiodeCircuit:
    """Add the output: a capacitor and a load."""
    return circuit.capacitor("C", "out", "0", farads).resistor("R", "out", "0", ohms)


def buck(ohms: float, farads: float = 1e-4) -> DiodeCircuit:
    """Return a step-down converter."""
    circuit = DiodeCircuit().voltage_source("V", "in", "0", VOLTS).switch("S", "in", "x", ON)
    return loaded(circuit.diode("D", "0", "x").inductor("L", "x", "out", 1e-4), ohms, farads)


def boost(ohms: float, farads: float = 1e-4) -> DiodeCircuit:
    """Return a step-up converter."""
    circuit = DiodeCircuit().voltage_source("V", "in", "0", VOLTS).inductor("L", "in", "x", 1e-4)
    return loaded(circuit.switch("S", "x", "0", ON).diode("D", "x", "out"), ohms, farads)


def synchronous_buck(ohms: float, on_resistance: float) -> DiodeCircuit:
    """Return a step-down converter with a second transistor in the place of the diode."""
    circuit = DiodeCircuit().voltage_source("V", "in", "0", VOLTS)
    circuit.transistor("S1", "in", "x", ON, on_resistance, body_diode_voltage=0.7)
    circuit.transistor("S2", "x", "0", OFF, on_resistance, body_diode_voltage=0.7)
    return loaded(circuit.inductor("L", "x", "out", 1e-4), ohms)


def full_bridge(ohms: float) -> DiodeCircuit:
    """Return a bridge whose load lies between its two legs, switched crosswise."""
    circuit = DiodeCircuit().voltage_source("V", "in", "0", VOLTS)
    for name, leg, upper, lower in (("A", "a", ON, OFF), ("B", "b", OFF, ON)):
        circuit.transistor(f"S{name}1", "in", leg, upper).transistor(f"S{name}2", leg, "0", lower)
    return circuit.inductor("L", "a", "c", 1e-3).resistor("R", "c", "b", ohms)


def cuk(ohms: float) -> DiodeCircuit:
    """Return a converter whose output is negative, with energy passed through a capacitor."""
    circuit = DiodeCircuit().voltage_source("V", "in", "0", VOLTS).inductor("L1", "in", "x", 1e-3)
    circuit.switch("S", "x", "0", ON).capacitor("C1", "x", "y", 1e-4).diode("D", "y", "0")
    return loaded(circuit.inductor("L2", "y", "out", 1e-3), ohms)


def check(name: str, found: float, law: float, tolerance: float) -> None:
    """Print a number beside its law, and stop where they differ by more than is said."""
    print(f"  {name:34} {found:14.9f}   law {law:14.9f}   within {tolerance:g}")
    if not abs(found - law) <= tolerance * abs(law):
        raise SystemExit(f"{name}: {found} is not within {tolerance:g} of {law}")


def titled(text: str, circuit: DiodeCircuit) -> SteadyState:
    """Find the steady state, and print what it took."""
    steady = circuit.steady_state()
    largest = abs(steady.multipliers[0])
    print(f"{text}: {steady.iterations} steps of Newton's method, largest multiplier {largest:.6f}")
    return steady


steady = titled("Buck converter", buck(2.0))
run = steady.run
check("mean output, D V", run.mean("v(out)"), DUTY * VOLTS, 1e-11)
check("current ripple, (1 - D) D V T/L", run.ripple("i(L)"), (1 - DUTY) * DUTY * VOLTS * T / 1e-4, 1e-3)
check("output ripple, T di/(8 C)", run.ripple("v(out)"), run.ripple("i(L)") * T / 8e-4, 1e-2)
check("efficiency", steady.efficiency(["R"], ["V"]), 1.0, 1e-10)
runs = {"buck": run}

steady = titled("Buck converter, light load", buck(200.0, farads=1e-2))
k = 2 * 1e-4 / (200.0 * T)
check(
    "mean output, 2 V/(1 + (1 + 4K/D2)**.5)",
    steady.run.mean("v(out)"),
    2 * VOLTS / (1 + math.sqrt(1 + 4 * k / DUTY**2)),
    1e-5,
)
runs["buck, light load"] = steady.run

steady = titled("Boost converter", boost(20.0))
check("mean output, V/(1 - D)", steady.run.mean("v(out)"), VOLTS / (1 - DUTY), 1e-3)
check("efficiency", steady.efficiency(["R"], ["V"]), 1.0, 1e-10)
steady = titled("Boost converter, light load", boost(2000.0, farads=1e-3))
k = 2 * 1e-4 / (2000.0 * T)
check(
    "mean output, V (1 + (1 + 4 D2/K)**.5)/2",
    steady.run.mean("v(out)"),
    VOLTS * (1 + math.sqrt(1 + 4 * DUTY**2 / k)) / 2,
    1e-4,
)
runs["boost, light load"] = steady.run

steady = titled("Synchronous buck converter, 50 mohm", synchronous_buck(2.0, 0.05))
check("mean output, D V R/(R + Ron)", steady.run.mean("v(out)"), DUTY * VOLTS * 2.0 / 2.05, 1e-10)
load, lost = steady.run.rms("v(out)") ** 2 / 2.0, 0.05 * steady.run.rms("i(L)") ** 2
check("efficiency, P/(P + Ron Irms**2)", steady.efficiency(["R"], ["V"]), load / (load + lost), 1e-10)

steady = titled("Full bridge", full_bridge(3.0))
check("mean output, (2 D - 1) V", steady.run.mean("v(c,b)"), (2 * DUTY - 1) * VOLTS, 1e-10)
half = math.exp(-3.0 / 1e-3 * DUTY * T), math.exp(-3.0 / 1e-3 * (1 - DUTY) * T)
swing = 2 * VOLTS / 3.0 * (1 - half[0]) * (1 - half[1]) / (1 - half[0] * half[1])
check("current ripple, of exponentials", steady.run.ripple("i(L)"), swing, 1e-10)
runs["full bridge"] = steady.run

steady = titled("Cuk converter", cuk(5.0))
check("mean output, -D V/(1 - D)", steady.run.mean("v(out)"), -DUTY * VOLTS / (1 - DUTY), 1e-3)
check("mean of C1, V - output", steady.run.mean("v(x,y)"), VOLTS - steady.run.mean("v(out)"), 1e-10)
check("ripple of L1, D V T/L1", steady.run.ripple("i(L1)"), DUTY * VOLTS * T / 1e-3, 1e-3)
check("efficiency", steady.efficiency(["R"], ["V"]), 1.0, 1e-10)
runs["Cuk"] = steady.run

figure = Figure(figsize=(9, 7), layout="constrained")
for axes, (name, found) in zip(figure.subplots(len(runs), sharex=True), runs.items(), strict=True):
    fine = found.refined(800)
    inductor = "L1" if name == "Cuk" else "L"
    axes.plot(1e6 * (fine.t - fine.t[0]), fine.current(inductor), color="tab:red")
    axes.set_ylabel(f"i({inductor}), A")
    axes.set_title(name, loc="left", fontsize="medium")
    axes.grid(alpha=0.3)
figure.align_ylabels()
axes.set_xlabel("microseconds of one period")
folder = Path(__file__).parent / "out"
folder.mkdir(parents=True, exist_ok=True)
figure.savefig(folder / "14_converters.png", dpi=120)
