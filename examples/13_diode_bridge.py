"""Smooth the rectified mains: a bridge of ideal diodes, a capacitor behind a small resistor, and a load.

Run it from the root of the project: .venv/bin/python examples/13_diode_bridge.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from pricing_core.models import DiodeCircuit

NETLIST = """* 12 V at 50 Hz into a bridge, 1000 uF and a load of 100 ohms
V1    a    b    SIN(0 17 50)
RS    a    c    0.5
D1    c    p
D2    b    p
D3    0    c
D4    0    b
C1    p    0    1000u
RL    p    0    100
.end
"""

circuit = DiodeCircuit.from_netlist(NETLIST)
model = circuit.to_lcs()
print(f"states {', '.join(model.state_names)}; multipliers {', '.join(model.multiplier_names)}")
print(f"passive: {model.is_passive}, stored energy {model.stored_energy[0, 0]:g} v(C1)^2 / 2")

# Ten periods; the last one is settled, and looked at closely.
times = np.concatenate([np.linspace(0.0, 0.18, 900, endpoint=False), np.linspace(0.18, 0.2, 4001)])
run = circuit.simulate((0.0, 0.2), t_eval=times)
settled = run.t >= 0.18
output, supply = run.voltage("p"), -run.current("V1")
conducting = np.mean(np.abs(supply[settled]) > 1e-9)
print(f"output {output[settled].mean():.4f} V, ripple {np.ptp(output[settled]):.4f} V")
print(f"supply current up to {supply[settled].max():.4f} A, for {conducting:.1%} of the time")
print(f"inrush at the first peak {supply.max():.2f} A")


# The same by an ordinary solver of C v' = max(0, |17 sin| - v)/R - v/100.
def slope(t: float, v: np.ndarray) -> np.ndarray:
    """Return v' of the output."""
    return (np.maximum(0.0, abs(17.0 * np.sin(100.0 * np.pi * t)) - v) / 0.5 - v / 100.0) / 1e-3


same = solve_ivp(slope, (0.0, 0.2), [0.0], t_eval=times, max_step=1e-4, rtol=1e-9, atol=1e-11).y[0]
print(f"at most {np.abs(output - same).max():.0e} V from an ordinary solver")
assert np.abs(output - same).max() < 1e-4

figure = Figure(figsize=(8, 5), layout="constrained")
above, below = figure.subplots(2, sharex=True)
milliseconds = 1000.0 * run.t
above.plot(milliseconds, np.abs(run.voltage("a", "b")), color="0.7", label="rectified source")
above.plot(milliseconds, output, color="tab:blue", label="output")
above.set_ylabel("volts")
above.legend(loc="lower right")
below.plot(milliseconds, supply, color="tab:red")
below.set_ylabel("supply current, amperes")
below.set_xlabel("milliseconds")
below.set_xlim(0.0, 100.0)
target = Path(__file__).parent / "out" / "13_diode_bridge.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
