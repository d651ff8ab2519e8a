"""What averaging the complementarity condition over a cell buys: the error of an American put on finer and finer grids.

Run it from the root of the project: .venv/bin/python examples/26_averaged_complementarity.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.american import Market, Option, price
from pricing_core.obstacle import Diffusion, Obstacle, ObstacleProblem
from pricing_core.obstacle.grid import Grid, grid_map
from pricing_core.obstacle.march import march

OUT = Path(__file__).parent / "out"
RATE, VOLATILITY, WIDTH = 0.05, 0.2, 1.1
SPOTS = np.array([0.85, 0.95, 1.0, 1.05, 1.2])
CELLS = np.unique(np.geomspace(32, 512, 25).round(-1).astype(int) // 2 * 2)


def put():
    """Return an American put with strike 1 over x = ln S, one year before expiry."""
    payoff = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
    drift = RATE - VOLATILITY**2 / 2.0
    ends = ("exponential", "exponential")
    return ObstacleProblem(Diffusion(VOLATILITY, drift, RATE), payoff, 1.0, lower=payoff, ends=ends)


def errors(complementarity):
    """Return the root mean square error over SPOTS for each number of cells."""
    true = [price(Option("put", 1.0, 1.0), Market(s, RATE, VOLATILITY), tolerance=1e-8).price for s in SPOTS]
    problem, found = put(), []
    for cells in CELLS:
        grid = Grid.of(grid_map(-WIDTH, WIDTH, int(cells), np.zeros(0), (False, False)), 1)
        values = march(problem, grid, complementarity=complementarity).now(np.log(SPOTS))
        found.append(np.sqrt(np.mean((values - true) ** 2)))
    return np.array(found)


def draw(found):
    """Return the figure."""
    figure = Figure(figsize=(6.5, 4.6), layout="constrained")
    axes = figure.subplots()
    styles = {
        "right-angle": ("#D55E00", "o", "right angle at the nodes, as in (11.65)"),
        "averaged": ("#0072B2", "s", "averaged over the cell"),
    }
    for kind, (colour, marker, label) in styles.items():
        axes.loglog(CELLS, found[kind], color=colour, marker=marker, markersize=4, linewidth=1.4, label=label)
    for order, kind in ((2, "right-angle"), (3, "averaged")):
        start = np.exp(np.log(found[kind]).mean() + order * np.log(CELLS).mean())
        axes.loglog(
            CELLS, start / CELLS.astype(float) ** order, color="#5a6570", linewidth=0.8, linestyle=":"
        )
        axes.annotate(f"order {order}", (CELLS[-1], start / CELLS[-1] ** order))
    axes.set(xlabel="cells", ylabel="error, in strikes", title="An American put by the same march")
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.12)
    axes.set_xticks([32, 64, 128, 256, 512], labels=["32", "64", "128", "256", "512"])
    axes.minorticks_off()
    axes.legend(frameon=False)
    return figure


def main():
    """Write examples/out/26_averaged_complementarity.png."""
    OUT.mkdir(exist_ok=True)
    found = {kind: errors(kind) for kind in ("right-angle", "averaged")}
    draw(found).savefig(OUT / "26_averaged_complementarity.png", dpi=150)
    orders = {kind: -np.polyfit(np.log(CELLS), np.log(error), 1)[0] for kind, error in found.items()}
    assert orders["averaged"] > 2.5
    assert 1.5 < orders["right-angle"] < 2.5
    assert found["averaged"][-1] < 2e-7
    print(
        f"{CELLS[-1]} cells: {found['right-angle'][-1]:.1e} at the nodes, {found['averaged'][-1]:.1e} averaged"
    )


if __name__ == "__main__":
    main()
