"""Figure 11.1: the value of an American put at different times before expiry, as a complementarity system.

The method of lines (11.60)-(11.62) turns the Black-Scholes equation into the system (11.63)-(11.64), which implicit
steps solve (11.65). The pricing engine, which works otherwise, says how far the curves are off.

Run it from the root of the project: .venv/bin/python examples/21_put_as_a_system.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.american import Market, Option, price
from pricing_core.lcs import LCS, TimeStepping, simulate

OUT = Path(__file__).parent / "out"
STRIKE, RATE, VOLATILITY = 100.0, 0.06, 0.3  # money; per year; per square root of a year
TIMES = [0.0, 0.1, 0.25, 0.5, 0.75]  # years before expiry
POINTS, LOWEST, HIGHEST = 101, 40.0, 250.0  # the strike is in the middle
COLOURS = ["#1c2733", "#56B4E9", "#009E73", "#E69F00", "#D55E00"]


def put_values():
    """Return the spots, the values at TIMES by (11.63), one row for each, and those of the pricing engine."""
    x = np.linspace(np.log(LOWEST / STRIKE), np.log(HIGHEST / STRIKE), POINTS)
    h = x[1] - x[0]
    n, one = POINTS, np.ones(POINTS - 1)
    A1 = (np.diag(one, 1) - np.diag(one, -1)) / (2 * h)  # (11.60)
    A1[0, :2], A1[-1, -2:] = [-1 / h, 1 / h], [-1 / h, 1 / h]
    A2 = (np.diag(one, 1) - 2 * np.eye(n) + np.diag(one, -1)) / h**2  # (11.61)
    A = VOLATILITY**2 / 2 * A2 + (RATE - VOLATILITY**2 / 2) * A1 - RATE * np.eye(n)  # (11.62)

    payoff = np.maximum(1.0 - np.exp(x), 0.0)
    zeros = np.zeros((1, n))
    system = LCS(  # (11.63)
        np.block([[A, zeros.T], [zeros, np.zeros((1, 1))]]),
        np.vstack([np.eye(n), zeros]),
        np.hstack([np.eye(n), -payoff[:, None]]),
    )
    start = np.append(payoff, 1.0)  # (11.64)
    run = simulate(system, start, (0.0, TIMES[-1]), method=TimeStepping(step=0.005), t_eval=TIMES)

    spots = STRIKE * np.exp(x)
    return spots, STRIKE * run.x[:, :n], engine_values(spots)


def engine_values(spots):
    """Return the values by the pricing engine, shape (len(TIMES), len(spots))."""
    return np.array(
        [
            [
                price(Option("put", STRIKE, tau), Market(spot, RATE, VOLATILITY), tolerance=1e-5).price
                for spot in spots
            ]
            for tau in TIMES
        ]
    )


def draw(spots, values):
    """Return the figure."""
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()
    for tau, row, colour in zip(TIMES, values, COLOURS, strict=True):
        label = f"{tau:g} years before expiry" if tau else "at expiry"
        axes.plot(spots, row, color=colour, label=label, linewidth=2.2 if tau == 0.0 else 1.6)
    axes.set(xlim=(65.0, 145.0), ylim=(0.0, 36.0), xlabel="spot S", ylabel="value of the put")
    axes.set_title(f"American put: strike {STRIKE:g}, rate {RATE:g}, volatility {VOLATILITY:g}")
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


def main():
    """Write examples/out/21_put_as_a_system.png."""
    OUT.mkdir(exist_ok=True)
    spots, values, true = put_values()
    draw(spots, values).savefig(OUT / "21_put_as_a_system.png", dpi=150)
    shown = spots <= 160.0
    assert np.max(np.abs(values - true)) < 0.02
    assert np.all(values >= np.maximum(STRIKE - spots, 0.0) - 1e-9)
    print(
        f"at most {np.max(np.abs(values - true)[:, shown]):.3f} from the pricing engine, of a strike of 100"
    )


if __name__ == "__main__":
    main()
