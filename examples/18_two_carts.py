"""Example 11.3: two carts with stops; states that are close together lead elsewhere by the order of the contacts.

Run it from the root of the project: .venv/bin/python examples/18_two_carts.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.lcs import LCS, simulate

OUT = Path(__file__).parent / "out"
APART = 1e-3
STARTS = {  # x1, x2 and their velocities
    "the first cart meets its wall first": (APART, -APART, -2.0, 1.0),
    "the second cart meets the first one first": (APART, APART, -2.0, 1.0),
    "both at once": (0.0, 0.0, -2.0, 1.0),
}
STYLES = [("#0072B2", "-"), ("#D55E00", "-"), ("#1c2733", "--")]


def carts():
    """Return (11.91)-(11.94) for the state (x1, x2, v1, v2)."""
    return LCS(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -1, 0, 0]],
        [[0, 0], [0, 0], [1, 1], [0, -1]],
        [[1, 0, 0, 0], [1, -1, 0, 0]],
    )


def solutions():
    """Return the trajectory from each of STARTS."""
    system = carts()
    return [simulate(system, start, (0.0, 9.0)) for start in STARTS.values()]


def draw(trajectories):
    """Return the figure."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    for i, axes in enumerate(figure.subplots(2, 1, sharex=True, sharey=True)):
        for label, run, (colour, style) in zip(STARTS, trajectories, STYLES, strict=True):
            fine = run.refined(600)
            axes.plot(fine.t, fine.x[:, i], color=colour, linestyle=style, label=label)
        axes.set_ylabel(f"$x_{i + 1}$")
        axes.grid(color="#e3e7eb", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_title(f"Two carts (example 11.3), started within {APART:g} of each other")
    figure.axes[1].set(xlabel="t", xlim=(0.0, 9.0))
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", frameon=False)
    return figure


def _early_jumps(run):
    return [event for event in run.events if event.kind == "jump" and event.time < 0.1]


def main():
    """Write examples/out/18_two_carts.png."""
    OUT.mkdir(exist_ok=True)
    trajectories = solutions()
    draw(trajectories).savefig(OUT / "18_two_carts.png", dpi=150)
    wall_first, carts_first, both = (_early_jumps(run) for run in trajectories)
    assert np.allclose(wall_first[-1].x_after, [0.0, 0.0, 0.5, 0.5], atol=10 * APART)
    assert np.allclose(carts_first[-1].x_after, [0.0, 0.0, 0.0, -0.5], atol=10 * APART)
    assert np.allclose(both[-1].x_after, 0.0, atol=1e-12)
    assert [event.order_sensitive for event in both] == [True]
    assert not any(event.order_sensitive for event in (*wall_first, *carts_first))
    for label, run in zip(STARTS, trajectories, strict=True):
        print(f"{label}:")
        for event in _early_jumps(run):
            sensitive = "; the order of the contacts matters here" if event.order_sensitive else ""
            velocities = ", ".join(f"{v + 0.0:.4f}" for v in event.x_after[2:].round(12))
            print(f"  t = {event.time:.6f}: velocities ({velocities}){sensitive}")


if __name__ == "__main__":
    main()
