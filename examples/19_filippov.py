"""Figure 11.2: solutions of Filippov's example (11.68), which reach the origin after infinitely many switches.

Run it from the root of the project: .venv/bin/python examples/19_filippov.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.lcs import LCS, simulate

OUT = Path(__file__).parent / "out"
STARTS = [(3.0, 1.0), (-2.0, 2.0), (-1.0, -3.0), (2.0, -2.5)]
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"]


def relay_system():
    """Return (11.68), x1' = -sgn x1 + 2 sgn x2, x2' = -2 sgn x1 - sgn x2, as a complementarity system.

    sgn x_i = 1 - u_a with 0 <= x_i + u_b _|_ u_a >= 0 and 0 <= 2 - u_a _|_ u_b >= 0.
    """
    rates = np.array([[-1, 2], [-2, -1]])
    B, C = np.zeros((2, 4)), np.zeros((4, 2))
    B[:, ::2], C[::2] = -rates, np.eye(2)
    D = np.kron(np.eye(2), [[0, 1], [-1, 0]])
    return LCS(np.zeros((2, 2)), B, C, D, f=rates.sum(axis=1), g=[0, 2, 0, 2])


def solutions():
    """Return one trajectory for each of STARTS, a little longer than it takes to the origin."""
    system = relay_system()
    return [simulate(system, start, (0.0, np.abs(start).sum() / 2 + 0.2)) for start in STARTS]


def draw(trajectories):
    """Return the figure."""
    figure = Figure(figsize=(6.5, 6.0), layout="constrained")
    axes = figure.subplots()
    for start, run, colour in zip(STARTS, trajectories, COLOURS, strict=True):
        axes.plot(*run.x.T, color=colour, linewidth=1.6)
        axes.plot(*start, "o", color=colour, markersize=5)
        middle, way = (run.x[0] + run.x[1]) / 2, run.x[1] - run.x[0]
        axes.annotate("", middle + 0.02 * way, middle, arrowprops={"arrowstyle": "->", "color": colour})
    axes.set(xlabel="$x_1$", ylabel="$x_2$", title="Filippov's example (11.68)", aspect="equal")
    for line in (axes.axhline, axes.axvline):
        line(0.0, color="#5a6570", linewidth=0.8)
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def main():
    """Write examples/out/19_filippov.png."""
    OUT.mkdir(exist_ok=True)
    trajectories = solutions()
    draw(trajectories).savefig(OUT / "19_filippov.png", dpi=150)
    assert np.allclose(trajectories[0](1.0), [4 / 3, -2 / 3], rtol=0.0, atol=1e-12)
    for start, run in zip(STARTS, trajectories, strict=True):
        (limit,) = (event for event in run.events if event.kind == "zeno")
        assert abs(limit.time - np.abs(start).sum() / 2) < 1e-12
        assert limit.x_after.tolist() == [0.0, 0.0]
        print(f"from {start}: at the origin at t = {limit.time:.12g}, rounds shrink by {1 / limit.ratio:.0f}")


if __name__ == "__main__":
    main()
