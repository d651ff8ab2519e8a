"""How does the time of a converter grow with its periods, and what do 30 diodes and 12 relays take?

    .venv/bin/python -m benchmarks.circuit_speed [PERIODS ...]

A line for every number of periods of a buck converter (1,000, 10,000 and 100,000 if missing) with its steady state's
output, one for 30 rectifiers of 60 states over 100 periods, and one for each report on 12 relays. Seconds are those of
the processor, for the machine may be shared; seconds by the clock stand beside them.
"""

import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from pricing_core.models import DiodeCircuit, Pulse, RelaySystem, Sine

T = 1e-5


def converter() -> DiodeCircuit:
    """Return a buck converter."""
    circuit = DiodeCircuit().voltage_source("V1", "in", "0", 12).switch("S1", "in", "x", Pulse(T, 0.4 * T))
    circuit.diode("D1", "0", "x").inductor("L1", "x", "out", 1e-4).capacitor("C1", "out", "0", 1e-4)
    return circuit.resistor("R1", "out", "0", 2)


def rectifiers(count: int) -> DiodeCircuit:
    """Return as many rectifiers, each with a choke and a smoothing capacitor, on one supply with an impedance."""
    circuit = DiodeCircuit().voltage_source("V", "s", "0", Sine(100, 50)).resistor("RS", "s", "b", 0.05)
    circuit.inductor("LS", "b", "n", 1e-4).resistor("RN", "n", "0", 20)
    for i in range(count):
        circuit.resistor(f"RL{i}", "n", f"m{i}", 0.5 + i / 30).inductor(f"L{i}", f"m{i}", f"k{i}", 1e-2)
        circuit.diode(f"D{i}", f"k{i}", f"o{i}").capacitor(f"C{i}", f"o{i}", "0", 1e-3 * (1 + i / 30))
        circuit.resistor(f"R{i}", f"o{i}", "0", 50 + i)
    return circuit


def relays(count: int, *, symmetric: bool) -> RelaySystem:
    """Return a system of random integers, C = B^T where it is symmetric."""
    random = np.random.default_rng(0)
    A, B, C = (random.integers(-3, 4, (count, count)) for _ in range(3))
    return RelaySystem(A, B, B.T if symmetric else C)


def timed(text: str, call: Callable[[], object]) -> object:
    """Make a call, and print how long it took."""
    begin, clock = time.process_time(), time.perf_counter()
    found = call()
    print(
        f"{text:52}{time.process_time() - begin:9.2f} s{time.perf_counter() - clock:9.2f} s by the clock",
        flush=True,
    )
    return found


def main(periods: tuple[int, ...] = (1_000, 10_000, 100_000)) -> None:
    """Print a line for each question."""
    circuit = converter()
    for count in periods:
        end = count * T
        timed(f"{count:,} periods of a converter", partial(circuit.simulate, (0.0, end), t_eval=[end]))
    timed("its steady state", circuit.steady_state)
    timed("30 rectifiers, 61 states, 100 periods", lambda: rectifiers(30).simulate((0.0, 2.0)))
    for symmetric in (True, False):
        kind = "C = B^T" if symmetric else "any C"
        timed(f"report on 12 relays, {kind}", relays(12, symmetric=symmetric).well_posedness)


if __name__ == "__main__":
    main(tuple(int(word) for word in sys.argv[1:]) or (1_000, 10_000, 100_000))
