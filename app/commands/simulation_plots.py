"""The picture of a simulation: quantities over time with events and modes, and the phase plane of two states."""

from collections.abc import Sequence
from typing import BinaryIO, Literal, NamedTuple

import numpy as np

from app.commands.boundary_plot import DOTS_PER_INCH, GREY
from app.commands.mode_band import Band
from app.commands.simulation import ROUNDING, Columns, Orbit, Samples, Simulation
from pricing_core.arrays import Matrix, Vector
from pricing_core.extras import needs_extra

with needs_extra("plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase
    from matplotlib.gridspec import SubplotSpec
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch


# Okabe and Ito's colours, which colour-blind readers can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4d4d4d")
BAND_COLOURS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#b8bfc6", "#4d4d4d")
EVENT_COLOURS = {
    "switch": GREY,
    "jump": "#c1121f",
    "zeno": "#7b2cbf",
    "grazing": "#2a9d8f",
    "input": "#b08900",
}
STYLES: tuple[Literal["-", "--", "-.", ":"], ...] = ("-", "--", "-.", ":")
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
WIDTH, ORBIT = 9.0, 4.6  # of the curves, and of the phase plane, in inches
SAME_SCALE = 25.0  # quantities within this factor share a panel
CROWDED = 30  # events that are drawn firmly
EQUAL = 1e-2  # share of a panel's height below which two lines are one to the eye
ALWAYS, OFTEN = 0.97, 0.1  # shares of the points from which on lines are equal, and equal in part
COMPARED = 1000  # points at which lines are compared, or somewhat more
DASH = 5.0  # length of a dash of lines that share a place, in line widths


class Legend(NamedTuple):
    """How large the names beside a panel are, how many lines are named, and how many rows of modes are shown."""

    size: float
    names: int
    rows: int


class Panel(NamedTuple):
    """Lines that share an axis."""

    title: str
    names: list[str]
    lines: list[Vector]


FULL = Legend(10.0, 12, 12)


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
    samples, band, orbit = simulation.curves, simulation.band, simulation.orbit
    panels = [panel for columns in samples.columns for panel in panels_of(columns, samples.columns)]
    heights = [max(1.9, 0.5 + 0.2 * min(len(panel.names), FULL.names)) for panel in panels] + (
        [] if band is None else [0.25 + 0.22 * rows_of(band)]
    )
    height = 1.6 + sum(heights)
    figure = Figure(figsize=(WIDTH + ORBIT * (orbit is not None), height), layout="constrained")
    figure.suptitle(f"{TITLES.get(simulation.model, 'Simulation')}\n{simulation.headline}", fontsize=11)
    left: FigureBase = figure
    right: FigureBase = figure
    if orbit is not None:
        left, right = figure.subfigures(1, 2, width_ratios=[WIDTH, ORBIT], squeeze=False)[0]
    grid = left.add_gridspec(len(heights), 1, height_ratios=heights)
    column = draw_curves(left, [grid[i] for i in range(len(heights))], simulation, panels)
    if orbit is not None:
        rest = max(height - 1.0 - ORBIT, 0.1)
        draw_orbit(right.add_subplot(right.add_gridspec(2, 1, height_ratios=[ORBIT, rest])[0]), orbit)
    handles, names = column[0].get_legend_handles_labels()
    events = [(handle, name) for handle, name in zip(handles, names, strict=True) if name in EVENT_COLOURS]
    if events:
        left.legend(*zip(*events, strict=True), loc="outside lower center", ncols=len(events), frameon=False)
    return figure


def draw_curves(
    figure: FigureBase,
    places: Sequence[SubplotSpec],
    simulation: Simulation,
    panels: Sequence[Panel],
    legend: Legend = FULL,
) -> list[Axes]:
    """Draw panels, and the band of modes where there is one, below each other over one axis of time."""
    samples, band = simulation.curves, simulation.band
    column: list[Axes] = []
    for place in places:
        column.append(figure.add_subplot(place, sharex=column[0] if column else None))
    for axes, panel in zip(column, panels, strict=False):
        _draw_panel(axes, samples, panel, legend)
        _mark_events(axes, simulation)
    if band is not None:
        _draw_band(column[-1], band, legend)
    for axes in column[:-1]:
        axes.tick_params(labelbottom=False)
    figure.align_ylabels(column)
    column[-1].set_xlabel(axis_label(samples))
    column[-1].ticklabel_format(axis="x", scilimits=(-3, 5))
    if samples.points.size > 1:
        column[-1].set_xlim(samples.points[0], samples.points[-1])
    return column


def axis_label(samples: Samples) -> str:
    """Return the name of the axis with its symbol and unit.

    Examples
    --------
    >>> axis_label(Samples("t", np.zeros(1), (), unit="s")), axis_label(Samples("k", np.zeros(1), ()))
    ('time t (s)', 'step k')
    """
    return with_unit(f"{AXES.get(samples.axis, '')} {samples.axis}".lstrip(), samples.unit)


def with_unit(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, where that is known."""
    return f"{name} ({unit})" if unit else name


def panels_of(columns: Columns, others: Sequence[Columns] = ()) -> list[Panel]:
    """Group quantities of one kind by their unit and size, the largest first.

    Those that are zero but for rounding, beside all of their kind and all others in their unit, join the last group of
    their unit, and are drawn as zero.
    """
    units = columns.units or ("",) * len(columns.names)
    sizes = _sizes(columns)
    panels = []
    for unit in dict.fromkeys(units):
        members = [i for i, own in enumerate(units) if own == unit]
        alike = [
            size
            for other in others
            for size, own in zip(_sizes(other), other.units, strict=False)
            if unit and own == unit
        ]
        rounding = ROUNDING * max([*sizes, *alike], default=0.0)
        panels += _of_one_unit(columns, unit, members, np.where(sizes > rounding, sizes, 0.0))
    return panels


def _sizes(columns: Columns) -> Vector:
    return np.asarray(np.max(np.abs(columns.values), axis=0, initial=0.0))


def _of_one_unit(columns: Columns, unit: str, members: list[int], sizes: Vector) -> list[Panel]:
    groups: list[list[int]] = []
    largest = 0.0
    for i in sorted(members, key=lambda member: -sizes[member]):
        if groups and (sizes[i] == 0.0 or sizes[i] * SAME_SCALE >= largest):
            groups[-1].append(i)
        else:
            groups.append([i])
            largest = sizes[i]
    return [
        Panel(
            with_unit(columns.title, unit),
            [columns.names[i] for i in group],
            [columns.values[:, i] if sizes[i] > 0.0 else 0.0 * columns.values[:, i] for i in group],
        )
        for group in map(sorted, groups)
    ]


def overlaps(lines: Sequence[Vector]) -> Matrix:
    """Return for every two lines the share of the points at which they cannot be told apart in the picture.

    Examples
    --------
    >>> overlaps([np.array([0.0, 1.0]), np.array([0.0, 2.0])])
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    height = max(
        (float(np.ptp(line[np.isfinite(line)])) for line in lines if np.isfinite(line).any()), default=0.0
    )
    table = np.array(lines)[:, :: max(1, lines[0].size // COMPARED)]
    return np.array([np.mean(np.abs(table - line) <= EQUAL * height, axis=1) for line in table])


def _draw_panel(axes: Axes, samples: Samples, panel: Panel, legend: Legend) -> None:
    shares = overlaps(panel.lines)
    handles, names = [], []
    for i, (name, line) in enumerate(zip(panel.names, panel.lines, strict=True)):
        equal = np.flatnonzero(shares[i] >= ALWAYS).tolist()
        over = np.count_nonzero((shares[i, i + 1 :] >= OFTEN) & (shares[i, i + 1 :] < ALWAYS))
        colour, style = COLOURS[i % len(COLOURS)], STYLES[i // len(COLOURS) % len(STYLES)]
        # Lines that are equal are drawn in turn, dash by dash; one that others lie upon in part is wider.
        dashes = (equal.index(i) * DASH, (DASH, (len(equal) - 1) * DASH))
        axes.plot(
            samples.points,
            line,
            color=colour,
            linestyle=dashes if len(equal) > 1 else style,
            linewidth=3.4 if over and len(equal) == 1 and style == "-" else 1.7,
            label=name,
            marker="o" if samples.points.size == 1 else "",
            dash_capstyle="butt",
        )
        handles.append(Line2D([], [], color=colour, linestyle=style, linewidth=1.7))
        names.append(name if equal[0] == i else f"{name} = {panel.names[equal[0]]}")
    axes.set_ylabel(panel.title)
    if not any(np.nan_to_num(line).any() for line in panel.lines):
        axes.set_ylim(-1.0, 1.0)
        axes.set_yticks([0.0])
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        handles[: legend.names],
        _shortened(names, legend.names),
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
        handlelength=1.6,
        fontsize=legend.size,
        labelspacing=0.05 * legend.size,
    )


def _shortened(names: Sequence[str], most: int) -> list[str]:
    hidden = len(names) - most
    return list(names) if hidden <= 0 else [*names[: most - 1], f"... {hidden + 1} more"]


def rows_of(band: Band, legend: Legend = FULL) -> int:
    """Return how many rows of modes are shown."""
    return min(len(band.names), legend.rows)


def _draw_band(axes: Axes, band: Band, legend: Legend) -> None:
    shown = rows_of(band, legend)
    for row in range(shown):
        bars = band.bars(row)
        colours = [BAND_COLOURS[state % len(BAND_COLOURS)] for _, _, state in bars]
        axes.broken_barh([bar[:2] for bar in bars], (row - 0.4, 0.8), facecolors=colours, linewidth=0.0)
    axes.set_yticks(range(shown), _shortened(band.names, legend.rows))
    axes.set_ylim(shown - 0.5, -0.5)
    axes.set_ylabel("mode")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0, labelsize=legend.size)
    used = sorted({state for row in range(shown) for *_, state in band.bars(row)})
    patches = [
        Patch(color=BAND_COLOURS[state % len(BAND_COLOURS)], label=band.words[state]) for state in used
    ]
    if patches:
        axes.legend(
            handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, handlelength=1.2
        )


def draw_orbit(axes: Axes, orbit: Orbit) -> None:
    """Draw one state against the other, from a filled to an open circle; jumps are dotted."""
    x = np.array(orbit.values)
    jumps = np.flatnonzero(np.diff(orbit.points) == 0.0)
    pieces = np.split(np.arange(len(x)), jumps + 1)
    for piece in pieces:
        axes.plot(*x[piece].T, color=COLOURS[0], linewidth=1.4)
    for i in jumps.tolist():
        axes.plot(*x[i : i + 2].T, color=EVENT_COLOURS["jump"], linewidth=1.0, linestyle=":")
    axes.plot(*x[0], "o", color=COLOURS[0], label="start")
    axes.plot(*x[-1], "o", color=COLOURS[0], markerfacecolor="white", label="end")
    axes.set_xlabel(with_unit(orbit.names[0], orbit.units[0]))
    axes.set_ylabel(with_unit(orbit.names[1], orbit.units[1]))
    axes.set_title("phase plane", fontsize=10)
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)


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
