"""Follow Filippov's two relays through infinitely many switches to the origin (example 11.1), and plot the spiral.

Run it from the root of the project: .venv/bin/python examples/20_relay.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pricing_core.models import RelaySystem

# x1' = -sgn x1 + 2 sgn x2, x2' = -2 sgn x1 - sgn x2.
system = RelaySystem(np.zeros((2, 2)), [[1, -2], [2, 1]], np.eye(2))
start = np.array([3.0, 1.0])

report = system.well_posedness()
run = system.simulate(start, (0.0, 2.5))
zeno = run.events[-1]

print(f"theorem 11.6 {report.theorems['11.6']}: {report.verdict}")
print(f"{len(run.events) - 1} switches, each round of four {zeno.ratio:.6f} times as long as the one before")
print(f"origin reached at t = {zeno.time:.12f}, (|x1| + |x2|)/2 = {np.abs(start).sum() / 2:.12f}")
assert report.theorems["11.6"] == "holds"
assert abs(zeno.time - np.abs(start).sum() / 2) < 1e-12

figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
axes.plot(run.x[:, 0], run.x[:, 1], linewidth=1.2)
axes.plot(*start, "o", markersize=5)
axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
axes.set(
    xlabel="$x_1$", ylabel="$x_2$", title="Infinitely many switches in two units of time", aspect="equal"
)
target = Path(__file__).parent / "out" / "20_relay.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
