"""Error against time per option, one colour per method, its lower envelope a line."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.measuring.frontier import Point, lower_envelope
from benchmarks.option_engine.work_precision import (
    CRANK_NICOLSON,
    ENGINE,
    LCS_PATH,
    ErrorMeasure,
    Measurement,
    points,
)
from benchmarks.quantlib.american_engines import FINITE_DIFFERENCES, LEISEN_REIMER, QD_FP

# Okabe and Ito's colours, which colour-blind readers can tell apart.
STYLES = {
    ENGINE: ("#D55E00", "o"),
    LCS_PATH: ("#E69F00", "s"),
    CRANK_NICOLSON: ("#CC79A7", "D"),
    QD_FP: ("#0072B2", "^"),
    FINITE_DIFFERENCES: ("#009E73", "v"),
    LEISEN_REIMER: ("#56B4E9", "P"),
}
ERRORS: tuple[tuple[ErrorMeasure, str], ...] = (("rmse", "RMSE"), ("largest_error", "largest error"))


def frontier_figure(measurements: Sequence[Measurement], title: str) -> Figure:
    """Draw RMSE and largest error, fractions of the strike, against microseconds per option."""
    figure = Figure(figsize=(11.0, 5.5), layout="constrained")
    for axes, (error, label) in zip(figure.subplots(1, 2, sharey=True), ERRORS, strict=True):
        for family, (colour, marker) in STYLES.items():
            reached = points(measurements, family, error)
            envelope = lower_envelope(reached)
            if envelope:
                _draw(axes, reached, fmt=marker, color=colour, alpha=0.35, markersize=4)
                _draw(axes, envelope, fmt=f"{marker}-", color=colour, markersize=5, label=family)
        axes.set_xlabel("time per option in microseconds")
        axes.set_ylabel(f"{label} as a fraction of the strike")
        axes.grid(which="major", alpha=0.3)
    figure.suptitle(title)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw(axes: Axes, reached: Sequence[Point], *, fmt: str, **style: Any) -> None:
    errors, times = zip(*reached, strict=True)
    axes.loglog(times, errors, fmt, **style)
