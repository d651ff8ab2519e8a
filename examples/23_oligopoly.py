"""Let three firms adjust their production to their profits, find the Nash equilibrium, and plot the way there.

Run it from the root of the project: .venv/bin/python examples/23_oligopoly.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pricing_core.models import ProjectedSystem

names, costs, capacities = ("cheap", "middle", "expensive"), np.array([10, 20, 60]), np.array([30, 50, 50])

# At the price 100 - Q firm i earns (100 - Q - cost_i) q_i and moves along its marginal profit -F_i(q).
F = np.eye(3) + 1.0, costs - 100.0
system = ProjectedSystem(F, np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([np.zeros(3), -capacities]))

nash = system.equilibrium()
run = system.simulate([10.0, 10.0, 10.0], (0.0, 5.0))

for name, quantity, cost in zip(names, nash.x, costs, strict=True):
    profit = round((100.0 - nash.x.sum() - cost) * quantity, 9) + 0.0  # no -0.00
    print(f"{name:9s} produces {quantity:7.3f} and earns {profit:8.2f}")
print(
    f"price {100.0 - nash.x.sum():.3f}; one more unit of capacity is worth {nash.u[3]:.3f} to the first firm"
)
# The cheap firm is at its capacity: 100 - 2 q2 - 30 = 20 makes the second one produce 25, and the third does not pay.
assert np.allclose(nash.x, [30.0, 25.0, 0.0], atol=1e-12)
assert abs(nash.u[3] - 5.0) < 1e-12
for event in run.events:
    print(f"a bound is met or left at t = {event.time:.6f}")

times = np.linspace(0.0, 5.0, 501)
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for name, quantities, end in zip(names, run(times).T, nash.x, strict=True):
    (line,) = axes.plot(times, quantities, label=name)
    axes.axhline(end, color=line.get_color(), linestyle=":", linewidth=1.0)
axes.set(
    xlabel="time t", ylabel="production", title="Three firms on their way to the Nash equilibrium (dotted)"
)
axes.legend()
target = Path(__file__).parent / "out" / "23_oligopoly.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
