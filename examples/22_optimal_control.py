"""Lower a cart along x'' = u to a floor and keep it there, at least cost: a state constraint of order 2.

Run it from the root of the project: .venv/bin/python examples/22_optimal_control.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.models import StateConstrainedLQ

PLOT = Path(__file__).parent / "out" / "22_optimal_control.png"

# Minimise (1/2) int 4 x^2 + u^2 over 4 seconds, from 2 at rest, never below 1.
cart = StateConstrainedLQ(
    A=[[0, 1], [0, 0]],
    B=[[0], [1]],
    C=[[1, 0]],
    Q=[[4, 0], [0, 0]],
    x0=[2, 0],
    horizon=4.0,
    bound=[1],
)
answer = cart.solve()
print(f"cost {answer.cost:.9f}  ({answer.status}, residual {answer.residual:.0e})")
for time in answer.switching_times:
    print(f"the cart reaches the floor at {time:.9f}")
for time, weights in answer.multiplier_atoms:
    print(f"the multiplier has an atom of {weights[0]:.9f} at {time:.9f}: there the costate jumps by as much")
# The closed form of this problem, from the conditions of Pontryagin with a jump of the costate at the junction.
assert abs(answer.cost - 13.521466835) < 1e-8
assert abs(answer.switching_times[0] - 1.954759358) < 1e-8
assert abs(answer.multiplier_atoms[0][1][0] - 2.889872101) < 1e-8
free = StateConstrainedLQ(cart.A, cart.B, cart.C, cart.Q, cart.x0, cart.horizon, bound=[-9]).solve()
print(f"the floor costs {answer.cost - free.cost:.9f}")

figure = Figure(figsize=(7.0, 7.0), layout="constrained")
position, control, costate = figure.subplots(3, 1, sharex=True)
position.plot(free.t, free.x[:, 0], color="0.6", linestyle="--", label="without the floor")
position.plot(answer.t, answer.x[:, 0], color="C0", label="position x")
position.axhline(1.0, color="C3", linewidth=0.8, label="floor")
control.plot(answer.t, answer.control[:, 0], color="C0", label="control u")
costate.plot(answer.t, answer.costate[:, 0], color="C0", label="costate of x")
costate.plot(answer.t, answer.multiplier[:, 0], color="C1", label="multiplier: density")
costate.stem(
    [time for time, _ in answer.multiplier_atoms],
    np.array([weights[0] for _, weights in answer.multiplier_atoms]),
    linefmt="C3-",
    markerfmt="C3^",
    basefmt=" ",
    label="multiplier: atom",
)
costate.set_xlabel("time t")
for axes in (position, control, costate):
    axes.legend(loc="best", frameon=False)
    axes.margins(x=0.01)
    for time in answer.switching_times:
        axes.axvline(time, color="0.8", linewidth=0.8, zorder=0)
PLOT.parent.mkdir(exist_ok=True)
figure.savefig(PLOT, dpi=120)
