"""Let a pendulum swing against a wall below its pivot, and plot its angle and its energy.

Run it from the root of the project: .venv/bin/python examples/17_pendulum.py
"""

from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import ellipk

from pricing_core.models import HamiltonianSystem

GRAVITY, RESTITUTION, START = 9.81, 0.8, 1.2

# H(q, p) = p^2/2 - g cos q for the angle q of a pendulum of length 1, which the wall keeps at q >= 0.
pendulum = HamiltonianSystem(
    energy=lambda q, p: float(0.5 * p[0] ** 2 - GRAVITY * np.cos(q[0])),
    gradient=lambda q, p: (GRAVITY * np.sin(q), p),
    constraints=lambda q: q,
    constraint_jacobian=lambda q: np.eye(1),
    restitution=RESTITUTION,
)
run = pendulum.simulate([START], [0.0], (0.0, 6.0), steps=6000)

# The quarter period is an elliptic integral; an impact keeps e^2 of the energy, and with it 1 - cos of the amplitude.
impacts = np.flatnonzero(run.impulses[:, 0])
quarter = ellipk(np.sin(START / 2.0) ** 2) / np.sqrt(GRAVITY)
print(f"first impact at t = {run.t[impacts[0]]:.3f}: a quarter of the period is {quarter:.4f}")
assert abs(run.t[impacts[0]] - quarter) < 2e-3
free = np.delete(np.diff(run.energy), impacts - 1)
print(f"between impacts the energy changes by at most {np.abs(free).max():.0e} in a step")
for count, (start, end) in enumerate(pairwise(impacts[:4]), start=1):
    amplitude = np.arccos(1.0 - RESTITUTION ** (2 * count) * (1.0 - np.cos(START)))
    assert abs(run.q[start:end, 0].max() - amplitude) < 1e-3  # the step is of order one at an impact
    print(f"swing {count} reaches {run.q[start:end, 0].max():.3f}: {amplitude:.4f} by the law of impact")

figure, (angle, energy) = plt.subplots(2, 1, figsize=(6, 5), sharex=True, layout="constrained")
angle.plot(run.t, run.q[:, 0])
angle.axhline(0.0, color="0.5", linewidth=0.8, label="wall")
angle.set(ylabel="angle q", title=f"A pendulum against a wall, restitution {RESTITUTION}")
angle.legend(loc="upper right")
energy.plot(run.t, run.energy, color="tab:red")
energy.set(xlabel="time t", ylabel="energy H")
target = Path(__file__).parent / "out" / "17_pendulum.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
