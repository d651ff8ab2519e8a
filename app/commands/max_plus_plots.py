"""Pictures of max-plus orbits and schedules; matplotlib is imported by whoever asks for one."""

from collections.abc import Sequence

import numpy as np

from pricing_core.errors import InvalidInputError, Told
from pricing_core.extras import needs_extra
from pricing_core.max_plus.event_graphs import Place, TimedEventGraph
from pricing_core.max_plus.matrices import EPSILON, Numbers, as_floats, as_matrix, dense
from pricing_core.max_plus.scalars import as_number

with needs_extra("plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLOURS = ("#1f5fa8", "#b5402f", "#3f8f4f", "#8a5fa8", "#b8860b", "#5a6570")
MOST_ROWS = 60
HEIGHT = 0.76  # of the bars, in rows


def gantt(graph: TimedEventGraph, x: object, *, unit: str = "") -> Figure:
    """Draw a schedule: one row per place that takes time, a bar for each token, numbered by firing.

    The tokens that are there at the beginning begin with row 0 and are numbered 0, -1, ...: firings of the past.

    Parameters
    ----------
    graph : TimedEventGraph
    x : array_like, shape (firings + 1, n)
        Firing times, as `graph.run` gives them.
    unit : str
        Unit of the times.

    Raises
    ------
    InvalidInputError
        x has another number of columns.
    """
    if not isinstance(graph, TimedEventGraph):
        raise InvalidInputError("graph", graph, "a TimedEventGraph")
    times = _finite("x", x)
    if times.shape[1] != len(graph.transitions):
        raise InvalidInputError("x", Told(f"shape {times.shape}"), f"of {len(graph.transitions)} columns")
    rows = [place for place in graph.places if place.holding > 0][:MOST_ROWS]
    figure = Figure(figsize=(9.0, 1.3 + 0.42 * max(len(rows), 2)), layout="constrained")
    axes = figure.subplots()
    for level, place in enumerate(rows):
        _bars(axes, level, place, times[:, graph.transitions.index(place.source)])
    axes.set_yticks(
        range(len(rows)), [f"{place.source} \N{RIGHTWARDS ARROW} {place.target}" for place in rows]
    )
    axes.invert_yaxis()
    axes.set_xlabel(f"time ({unit})" if unit else "time")
    axes.set_title("Each bar is one token's stay, numbered by the firing that it follows", fontsize=10)
    _plain(axes)
    return figure


def orbit(times: object, names: Sequence[str], *, rate: float | None = None) -> Figure:
    """Draw the times of all events against their number, and below what they are ahead of a steady rate.

    Parameters
    ----------
    times : array_like, shape (k, n)
    names : sequence of n str
    rate : float, optional
        The largest cycle time, which the lower panel subtracts. Default, and for -inf: the mean over the run.

    Raises
    ------
    InvalidInputError
        `names` has another length.
    """
    values = _finite("times", times)
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise InvalidInputError("names", names, "a list of names")
    if values.shape[1] != len(names):
        raise InvalidInputError("names", Told(f"{len(names)} names"), f"for times of shape {values.shape}")
    number = np.arange(len(values))
    steady = _mean_rate(values) if rate is None or rate == EPSILON else float(as_number("rate", rate))
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for i, name in enumerate(str(name) for name in names[:MOST_ROWS]):
        style = {"color": COLOURS[i % len(COLOURS)], "marker": ".", "linewidth": 1.2}
        upper.plot(number, values[:, i], label=name, **style)
        lower.plot(number, values[:, i] - steady * number, **style)
    upper.set_ylabel("time")
    lower.set_ylabel(f"time less {steady:.4g} per event")
    lower.set_xlabel("number of the event")
    lower.xaxis.get_major_locator().set_params(integer=True)
    figure.legend(loc="outside right upper", frameon=False)
    for axes in (upper, lower):
        _plain(axes)
    return figure


def _bars(axes: Axes, level: int, place: Place, starts: Numbers) -> None:
    """Draw the stays in one row, beside each other where they overlap."""
    length = float(place.holding)
    first, *later = starts.tolist()
    stays = [(-k, first) for k in reversed(range(place.tokens))] + list(enumerate(later, 1))
    shown = [(k, start) for k, start in stays if np.isfinite(start)]
    lanes = _lanes([start for _, start in shown], length)
    height = HEIGHT / (1 + max(lanes, default=0))
    for (k, start), lane in zip(shown, lanes, strict=True):
        middle = level - HEIGHT / 2 + (lane + 0.5) * height
        axes.barh(
            middle, length, left=start, height=height, color=COLOURS[k % len(COLOURS)], edgecolor="white"
        )
        axes.text(start + length / 2, middle, str(k), ha="center", va="center", color="white", fontsize=7)


def _finite(field: str, times: object) -> Numbers:
    """Return times as floats, NaN for those that are none."""
    values = as_floats(dense(as_matrix(field, times)))
    return np.where(np.isfinite(values), values, np.nan)


def _lanes(starts: Sequence[float], length: float) -> list[int]:
    """Return for each stay the first lane that is free when it begins."""
    ends: list[float] = []
    chosen = []
    for start in starts:
        free = [lane for lane, end in enumerate(ends) if end <= start + 1e-9 * length]
        lane = free[0] if free else len(ends)
        ends[lane : lane + 1] = [start + length]
        chosen.append(lane)
    return chosen


def _mean_rate(values: Numbers) -> float:
    gained = values[-1] - values[0]
    known = gained[np.isfinite(gained)]
    return float(known.max() / max(len(values) - 1, 1)) if known.size else 0.0


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
