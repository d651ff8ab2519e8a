"""The picture of a simulation: states, then multipliers and slacks, over time, with the events marked."""

from collections.abc import Sequence
from typing import BinaryIO, NamedTuple

import numpy as np

from app.commands.boundary_plot import DOTS_PER_INCH, GREY
from app.commands.simulation import ROUNDING, Columns, Samples, Simulation
from pricing_core.arrays import Vector
from pricing_core.extras import needs_extra

with needs_extra("plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Okabe and Ito's colours, which colour-blind readers can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4d4d4d")
EVENT_COLOURS = {
    "switch": GREY,
    "jump": "#c1121f",
    "zeno": "#7b2cbf",
    "grazing": "#2a9d8f",
    "input": "#b08900",
}
STYLES = ("-", "--", "-.", ":")
AXES = {"t": "time", "k": "step"}
TITLES = {
    "lcs": "Linear complementarity system",
    "relay": "Relay system",
    "piecewise-linear": "Piecewise linear system",
    "projected": "Projected system",
    "mechanics": "Mechanical system with contacts",
    "circuit": "Circuit with ideal diodes",
    "optimal-control": "Optimal control",
    "max-plus": "Max-plus linear system",
}
SAME_SCALE = 25.0  # quantities within this factor share a panel
NAMED = 12  # lines in a legend
CROWDED = 30  # events that are drawn firmly


class Panel(NamedTuple):
    """Lines that share an axis."""

    title: str
    names: list[str]
    lines: list[Vector]


def draw_simulation(simulation: Simulation, file: BinaryIO) -> None:
    """Draw a simulation; quantities of very different size are drawn in panels of their own.

    Parameters
    ----------
    file : BinaryIO
        Open for writing; receives a PNG image.
    """
    figure = simulation_figure(simulation) if simulation.picture is None else simulation.picture()
    figure.savefig(file, format="png", dpi=DOTS_PER_INCH)


def simulation_figure(simulation: Simulation) -> Figure:
    """Return the picture as a figure."""
    samples = simulation.curves
    panels = [panel for columns in samples.columns for panel in panels_of(columns)]
    figure = Figure(figsize=(9.0, 1.5 + 1.9 * len(panels)), layout="constrained")
    figure.suptitle(f"{TITLES.get(simulation.model, 'Simulation')}\n{simulation.headline}", fontsize=11)
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(grid, panels, strict=True):
        _draw_panel(axes, samples, panel)
        _mark_events(axes, simulation)
    figure.align_ylabels(grid)
    grid[-1].set_xlabel(axis_label(samples))
    grid[-1].ticklabel_format(axis="x", scilimits=(-2, 5))
    if samples.points.size > 1:
        grid[-1].set_xlim(samples.points[0], samples.points[-1])
    handles, names = grid[0].get_legend_handles_labels()
    events = [(handle, name) for handle, name in zip(handles, names, strict=True) if name in EVENT_COLOURS]
    if events:
        figure.legend(
            *zip(*events, strict=True), loc="outside lower center", ncols=len(events), frameon=False
        )
    return figure


def axis_label(samples: Samples) -> str:
    """Return the name of the axis with its symbol and unit.

    Examples
    --------
    >>> axis_label(Samples("t", np.zeros(1), (), unit="s")), axis_label(Samples("k", np.zeros(1), ()))
    ('time t (s)', 'step k')
    """
    unit = f" ({samples.unit})" if samples.unit else ""
    return f"{AXES.get(samples.axis, '')} {samples.axis}{unit}".lstrip()


def panels_of(columns: Columns) -> list[Panel]:
    """Group quantities of one kind by their size, the largest first.

    Those that are zero but for rounding join the last group.
    """
    sizes = np.max(np.abs(columns.values), axis=0, initial=0.0)
    sizes[sizes <= ROUNDING * np.max(sizes, initial=0.0)] = 0.0
    groups: list[list[int]] = []
    for i in np.argsort(-sizes, kind="stable").tolist():
        if groups and (sizes[i] == 0.0 or sizes[i] * SAME_SCALE >= sizes[groups[-1][0]]):
            groups[-1].append(i)
        else:
            groups.append([i])
    return [
        Panel(columns.title, [columns.names[i] for i in group], [columns.values[:, i] for i in group])
        for group in map(sorted, groups)
    ]


def _draw_panel(axes: Axes, samples: Samples, panel: Panel) -> None:
    for i, (name, line) in enumerate(zip(panel.names, panel.lines, strict=True)):
        axes.plot(
            samples.points,
            line,
            color=COLOURS[i % len(COLOURS)],
            linestyle=STYLES[i // len(COLOURS) % len(STYLES)],
            linewidth=max(2.4 - 0.4 * i, 1.2),  # a line shows behind another that coincides with it
            label=name,
            marker="o" if samples.points.size == 1 else "",
        )
    axes.set_ylabel(panel.title)
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    handles, names = axes.get_legend_handles_labels()
    axes.legend(
        handles[:NAMED],
        _shortened(names),
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
        handlelength=1.6,
    )


def _shortened(names: Sequence[str]) -> list[str]:
    hidden = len(names) - NAMED
    return list(names) if hidden <= 0 else [*names[: NAMED - 1], f"... {hidden + 1} more"]


def _mark_events(axes: Axes, simulation: Simulation) -> None:
    firm = 0.8 if len(simulation.events) <= CROWDED else 0.35
    for kind, colour in EVENT_COLOURS.items():
        times = [event.time for event in simulation.events if event.kind == kind]
        if times:
            # From the bottom to the top of the panel, whatever its values.
            axes.vlines(
                times,
                0.0,
                1.0,
                transform=axes.get_xaxis_transform(),
                color=colour,
                linewidth=0.9,
                linestyle=":" if kind == "switch" else "--",
                alpha=firm,
                label=kind,
                zorder=0.5,
            )
