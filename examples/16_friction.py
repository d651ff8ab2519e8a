"""Let a mass on a spring come to rest by Coulomb friction, and plot its motion and the friction force.

Run it from the root of the project: .venv/bin/python examples/16_friction.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pricing_core.models import PiecewiseLinearSystem, coulomb_friction

# q'' = -q + u, where the friction u opposes the velocity q' with at most 1, and holds the mass with up to 1 at rest.
system = PiecewiseLinearSystem([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], None, [coulomb_friction(1.0)])
run = system.simulate([5.3, 0.0], (0.0, 12.0))

# Each half swing turns about -+1 and is 2 shorter: 5.3, -3.3, 1.3, and then 0.7, where the friction can hold.
print(f"half swings end at {', '.join(f'{switch.time:.6f}' for switch in run.switches)}")
print(f"the mass sticks at q = {run.x[-1, 0]:.12f} from t = 3 pi on, held by u = {run.u[-1, 0]:.12f}")
assert np.allclose([switch.time for switch in run.switches], np.pi * np.arange(1, 4), atol=1e-11)
assert abs(run.x[-1, 0] - 0.7) < 1e-12

times = np.linspace(0.0, 12.0, 601)
figure, (motion, force) = plt.subplots(2, 1, figsize=(6, 5), sharex=True, layout="constrained")
motion.plot(times, run(times)[:, 0])
motion.fill_between(times, -1.0, 1.0, color="0.93", label="where friction can hold the spring")
motion.set(ylabel="position q", title="Coulomb friction stops an oscillator")
motion.legend(loc="upper right")
force.plot(run.t, run.u[:, 0], color="tab:red")
force.set(xlabel="time t", ylabel="friction force u")
target = Path(__file__).parent / "out" / "16_friction.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
