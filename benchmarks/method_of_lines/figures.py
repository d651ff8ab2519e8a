"""Figures of the comparison of methods: error against work, profiles, and the relaxation of PSOR."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from benchmarks.measuring.frontier import Point, lower_envelope
from benchmarks.method_of_lines.accuracy import OUTPUTS, UNITS
from benchmarks.method_of_lines.lcp_study import RelaxationRun
from benchmarks.method_of_lines.profiles import Profile


class Style(NamedTuple):
    """Warm colours for the method of lines, cold ones for Crank-Nicolson; broken lines for adaptive steps."""

    colour: str
    marker: str
    line: str = "-"


STYLES = {
    "implicit Euler, uniform steps": Style("#8a8a8a", "x"),
    "implicit Euler, square-root steps": Style("#4d4d4d", "+"),
    "implicit Euler, adaptive steps": Style("#4d4d4d", "1", "--"),
    "implicit Euler, uniform steps, explicit projection": Style("#b8b8b8", "2", ":"),
    "SDIRK2, uniform steps": Style("#f0c000", "D"),
    "SDIRK2, square-root steps": Style("#e69f00", "s"),
    "SDIRK2, adaptive steps": Style("#e69f00", "h", "--"),
    "SDIRK2, square-root steps, boundary in its cell": Style("#d55e00", "o"),
    "SDIRK2, square-root steps, boundary in its cell, extrapolated": Style("#7a2000", "*"),
    "Crank-Nicolson, uniform steps, explicit projection": Style("#7fc4f2", "v", ":"),
    "Crank-Nicolson, uniform steps": Style("#0072b2", "^"),
    "Crank-Nicolson without damping, uniform steps": Style("#9b59d0", "<", ":"),
    "Crank-Nicolson, square-root steps": Style("#009e73", "P"),
    "Crank-Nicolson, adaptive steps": Style("#009e73", "d", "--"),
    "Crank-Nicolson, square-root steps, boundary in its cell": Style("#cc79a7", "X"),
    "Crank-Nicolson, square-root steps, boundary in its cell, extrapolated": Style("#5b2a86", "p"),
}


def error_figure(
    curves: Mapping[str, Mapping[str, Sequence[Point]]], work: str, title: str, *, envelope_gain: float | None
) -> Figure:
    """Draw the error of every output against work, one line per method.

    Parameters
    ----------
    curves : mapping
        Method to output to points.
    work : str
        What the points' second coordinate is, with its unit.
    envelope_gain : float, optional
        Draw the points, and a line through those of the lower envelope only, each better by this share than
        the one before; None draws a line through all.
    """
    figure = Figure(figsize=(11.0, 9.5), layout="constrained")
    for axes, output in zip(figure.subplots(2, 2).flat, OUTPUTS, strict=True):
        for method, points in curves.items():
            _draw(axes, points[output], method, envelope_gain)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_title(output)
        axes.set_xlabel(work)
        axes.set_ylabel(f"RMSE, {UNITS[output]}")
        axes.grid(which="major", color="#e3e7eb", linewidth=0.6)
    _finish(figure, title)
    return figure


def _draw(axes: Axes, points: Sequence[Point], method: str, envelope_gain: float | None) -> None:
    colour, marker, line = STYLES[method]
    joined: Sequence[Point] = points
    if envelope_gain is not None:
        axes.loglog(*_coordinates(points), marker, color=colour, alpha=0.3, markersize=4)
        joined = lower_envelope(points, envelope_gain)
    axes.loglog(*_coordinates(joined), f"{marker}{line}", color=colour, markersize=6, label=method)


def _coordinates(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    return [point[1] for point in points], [point.error for point in points]


def profile_figure(profiles: Sequence[Profile], labels: tuple[str, str], title: str, least: float) -> Figure:
    """Draw every profile in a panel of its own, all on one scale that is linear below `least`."""
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    panels = figure.subplots(len(profiles), 1, sharex=True, sharey=True)
    ticks = _symmetric_ticks(least, max(float(np.max(np.abs(profile.y))) for profile in profiles))
    for axes, profile in zip(panels, profiles, strict=True):
        axes.plot(profile.x, profile.y, color=STYLES[profile.label].colour, linewidth=1.5)
        axes.set_yscale("symlog", linthresh=least)
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.axhline(0.0, color="#5a6570", linewidth=0.6)
        axes.set_title(profile.label, loc="left", fontsize=10)
        axes.grid(color="#e3e7eb", linewidth=0.6)
    panels[-1].set_xlabel(labels[0])
    figure.supylabel(labels[1], fontsize=10)
    figure.suptitle(title)
    return figure


def _symmetric_ticks(least: float, largest: float) -> list[float]:
    """Return 0 and every other power of ten times `least` up to `largest`, of both signs."""
    powers = [10.0 * least]
    while 100.0 * powers[-1] <= largest:
        powers.append(100.0 * powers[-1])
    return [*(-power for power in reversed(powers)), 0.0, *powers]


def relaxation_figure(runs: Sequence[RelaxationRun]) -> Figure:
    """Draw the sweeps of PSOR per step against the relaxation parameter, one line per grid."""
    figure = Figure(figsize=(9.0, 5.5), layout="constrained")
    axes = figure.subplots()
    grids = sorted({(run.intervals, run.steps) for run in runs})
    for (intervals, steps), colour in zip(grids, ("#e69f00", "#009e73", "#0072b2"), strict=False):
        chosen = [run for run in runs if run.intervals == intervals]
        relaxations, sweeps = zip(*((run.relaxation, run.sweeps) for run in chosen), strict=True)
        axes.semilogy(relaxations, sweeps, "o-", color=colour, label=f"{intervals} cells, {steps} steps")
        best = int(np.argmin(sweeps))
        axes.annotate(
            f"{relaxations[best]:g}",
            (relaxations[best], sweeps[best]),
            xytext=(0, -14),
            textcoords="offset points",
            ha="center",
        )
    ticks = [20, 50, 100, 200, 500, 1000]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_xlabel("relaxation parameter")
    axes.set_ylabel("sweeps per step (mean)")
    axes.grid(which="both", color="#e3e7eb", linewidth=0.6)
    _finish(figure, "Projected SOR: sweeps against relaxation")
    return figure


def _finish(figure: Figure, title: str) -> None:
    figure.suptitle(title)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False
    )
