"""One figure for every report: panels of curves, each curve a colour and marker that it keeps in all panels."""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from typing import Any, TypeAlias

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.measuring.frontier import Point, lower_envelope

# Okabe and Ito's colours, which colour-blind readers can tell apart; with markers and lines no two curves are alike.
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS, LINES = "osv^DPX*<>", ("-", "--", ":")
Panels: TypeAlias = Mapping[str, Mapping[str, Iterable[tuple[float, float]]]]


def curves(
    panels: Panels,
    x: str,
    y: str | Sequence[str],
    title: str = "",
    *,
    envelope: float | None = None,
    scales: tuple[str, str] = ("log", "log"),
    linear_below: float | None = None,
    markers: bool = True,
) -> Figure:
    """Draw pairs (x, y) by panel and curve; curves without pairs are left out.

    Parameters
    ----------
    panels : mapping
        Title of a panel to label of a curve to its pairs.
    x, y : str
        What the axes show; y as a sequence says it for each panel.
    title : str, optional
    envelope : float, optional
        Draw the pairs as faint markers, and a line through those that no other one beats in both, each with a y better
        by this share than the one before.
    scales : pair of str, optional
        As Matplotlib names them; "symlog" is linear below `linear_below`.
    linear_below : float, optional
    markers : bool, optional
        Whether a line has markers at its pairs.
    """
    across = min(len(panels), 3 if len(panels) > 4 else 2)
    down = ceil(len(panels) / across)
    figure = Figure(figsize=(11.0 if across > 1 else 9.0, 1.2 + 4.2 * down), layout="constrained")
    labels = list(dict.fromkeys(label for panel in panels.values() for label in panel))
    shared = linear_below is not None
    places = list(figure.subplots(down, across, squeeze=False, sharex=shared, sharey=shared).flat)
    names = [y] * len(panels) if isinstance(y, str) else y
    for axes, (name, panel), what in zip(places, panels.items(), names, strict=False):
        for label, pairs in panel.items():
            _draw(axes, list(pairs), label, style_of(labels.index(label), markers=markers), envelope)
        axes.set_xscale(scales[0])
        axes.set_yscale(scales[1], **({} if linear_below is None else {"linthresh": linear_below}))
        axes.set(title=name, xlabel=x, ylabel=what)
        axes.grid(which="major", color="#e3e7eb", linewidth=0.6)
    for axes in places[len(panels) :]:
        axes.set_axis_off()
    figure.suptitle(title)
    handles = {label: line for axes in figure.axes for line, label in _legend(axes)}
    if len(handles) > 1:
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=2, frameon=False
        )
    return figure


def style_of(k: int, *, markers: bool = True) -> dict[str, Any]:
    """Return colour, marker and line of the k-th curve."""
    line = LINES[k // len(COLOURS) % len(LINES)]
    marker = MARKERS[k % len(MARKERS)] if markers else ""
    return {"color": COLOURS[k % len(COLOURS)], "marker": marker, "linestyle": line}


def _draw(
    axes: Axes,
    pairs: Sequence[tuple[float, float]],
    label: str,
    style: Mapping[str, Any],
    envelope: float | None,
) -> None:
    if envelope is not None:
        axes.plot(*_columns(pairs), **{**style, "linestyle": "", "alpha": 0.3, "markersize": 4})
        best = lower_envelope((Point(error, work) for work, error in pairs), envelope)
        pairs = [(work, error) for error, work in best]
    if pairs:
        axes.plot(*_columns(pairs), label=label, markersize=6, **style)


def _columns(pairs: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def _legend(axes: Axes) -> Iterable[tuple[Any, str]]:
    return zip(*axes.get_legend_handles_labels(), strict=True)
