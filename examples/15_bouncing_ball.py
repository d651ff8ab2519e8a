"""Drop a ball that bounces infinitely often in finite time and then rests, and plot its height and its energy.

Run it from the root of the project: .venv/bin/python examples/15_bouncing_ball.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pricing_core.models import MechanicalSystem

GRAVITY, RESTITUTION = 9.81, 0.7

# q'' = -g + u, 0 <= q _|_ u >= 0, with v+ = -e v- where there is an impulse.
ball = MechanicalSystem([[1]], [[0]], [[0]], [[1]], force=[-GRAVITY], restitution=RESTITUTION)
run = ball.simulate([1.0], [0.0], (0.0, 3.0))

# It falls for sqrt(2/g); every bounce takes e times as long as the one before, all of them 2 e/(1 - e) falls together.
impacts = [event for event in run.events if event.kind == "jump"]
rest = next(event for event in run.events if event.kind == "zeno")
print(f"first impact at t = {impacts[0].time:.12f}, {impacts[0].energy_lost:.9f} of {GRAVITY:.9f} lost")
print(f"at rest from t = {rest.time:.12f} on, each bounce {rest.ratio:.9f} of the one before")
fall = np.sqrt(2.0 / GRAVITY)
assert abs(impacts[0].time - fall) < 1e-12
assert abs(rest.time - fall * (1.0 + RESTITUTION) / (1.0 - RESTITUTION)) < 1e-11
assert abs(run.u[-1, 0] - GRAVITY) < 1e-12
print(f"the floor then bears u = {run.u[-1, 0]:.12f}")

fine = run.refined(2000)
figure, (height, energy) = plt.subplots(2, 1, figsize=(6, 5), sharex=True, layout="constrained")
height.plot(fine.t, fine.x[:, 0])
height.axvline(rest.time, color="0.5", linewidth=0.8, linestyle="--", label="at rest")
height.set(ylabel="height q", title=f"A ball with restitution {RESTITUTION}")
height.legend(loc="upper right")
energy.plot(fine.t, 0.5 * np.square(fine.x[:, 1]) + GRAVITY * fine.x[:, 0], color="tab:red")
energy.set(xlabel="time t", ylabel="energy")
target = Path(__file__).parent / "out" / "15_bouncing_ball.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
