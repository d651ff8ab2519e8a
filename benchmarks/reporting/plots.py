"""One figure for every report: panels of curves, each curve a colour and marker that it keeps in all panels."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any, TypeAlias

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.measuring.frontier import Point, lower_envelope

# Okabe and Ito's colours, which colour-blind readers can tell apart; with markers and lines no two curves are alike.
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS, LINES = "osv^DPX*<>", ("-", "--", ":")
MOST_MARKED = 50  # pairs of a curve that has a marker at each
Pairs: TypeAlias = Sequence[tuple[float, float]]
Panels: TypeAlias = Mapping[str, Mapping[str, Pairs]]


def curves(
    panels: Panels,
    x: str,
    y: str | Sequence[str],
    title: str = "",
    *,
    envelope: float | None = None,
    scales: tuple[str, str] = ("log", "log"),
    linear_below: float | None = None,
) -> Figure:
    """Draw pairs (x, y) by panel and curve; curves without pairs are left out.

    With `envelope` the pairs are faint markers, and a line goes through those that no other one beats in both, each
    with a y better by this share than the one before. A scale "symlog" is linear below `linear_below`; the panels then
    share their axes. `y` names the axes of all panels, or of each.
    """
    across = min(len(panels), 3 if len(panels) > 4 else 2)
    down, shared = ceil(len(panels) / across), linear_below is not None
    figure = Figure(figsize=(11.0 if across > 1 else 9.0, 1.2 + 4.2 * down), layout="constrained")
    places = figure.subplots(down, across, squeeze=False, sharex=shared, sharey=shared).flat
    labels = list(dict.fromkeys(label for panel in panels.values() for label in panel))
    names = [y] * len(panels) if isinstance(y, str) else y
    for axes, (name, panel), what in zip(places, panels.items(), names, strict=False):
        for label, pairs in panel.items():
            _draw(axes, pairs, label, labels.index(label), envelope)
        axes.set_xscale(scales[0])
        axes.set_yscale(scales[1], **({} if linear_below is None else {"linthresh": linear_below}))
        axes.set(title=name, xlabel=x, ylabel=what)
        axes.grid(which="major", color="#e3e7eb", linewidth=0.6)
    for axes in figure.axes[len(panels) :]:
        axes.set_axis_off()
    figure.suptitle(title)
    if len(labels) > 1:
        found = [axes.get_legend_handles_labels() for axes in figure.axes]
        handles = {label: line for pair in found for line, label in zip(*pair, strict=True)}
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=2, frameon=False
        )
    return figure


def _draw(axes: Axes, pairs: Pairs, label: str, k: int, envelope: float | None) -> None:
    marker = MARKERS[k % len(MARKERS)] if len(pairs) <= MOST_MARKED else ""
    style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": marker}
    if envelope is not None and pairs:
        axes.plot(*zip(*pairs, strict=True), linestyle="", alpha=0.3, markersize=4, **style)
        best = lower_envelope((Point(error, work) for work, error in pairs), envelope)
        pairs = [(work, error) for error, work in best]
    if pairs:
        axes.plot(
            *zip(*pairs, strict=True), linestyle=LINES[k // len(COLOURS) % len(LINES)], label=label, **style
        )
