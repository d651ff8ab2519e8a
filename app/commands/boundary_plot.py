"""The picture of an exercise boundary, as PNG; importing this module imports matplotlib."""

import math
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from pricing_core.american import ExerciseBoundary, LocalVolatility, Market, Option, PiecewiseConstant
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.american.contracts.carry import carry_yield
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.perpetual import perpetual_boundary
from pricing_core.arrays import BoolVector, Vector
from pricing_core.extras import needs_extra

with needs_extra("plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BLUE, RED, GREY, AMBER = "#1f5fa8", "#b5402f", "#5a6570", "#96610a"
MOST_NAMED = 12  # Largest number of ex-times that are written out; chosen.
DOTS_PER_INCH = 150


def draw_boundary(found: ExerciseBoundary, option: Option, market: Market, file: BinaryIO) -> None:
    """Draw the exercise boundary against calendar time, with the levels that it runs between.

    Parameters
    ----------
    file : BinaryIO
        Open for writing; receives a PNG image.
    """
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()
    draw_boundary_on(axes, found, option, market)
    _describe(axes, option, market)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(file, format="png", dpi=DOTS_PER_INCH)


def draw_boundary_on(axes: Axes, found: ExerciseBoundary, option: Option, market: Market) -> None:
    """Draw the boundary, the region beyond it, and the levels that it runs between."""
    ex_times = ex_times_of(option, market)
    found = _in_pieces(found, option, ex_times)
    _draw_curve(axes, found.time, found.boundary, "exercise boundary")
    if found.other_boundary is not None:
        _draw_curve(axes, found.time, found.other_boundary, "other boundary", "-.")
    levels = _perpetual_levels(option, market)
    axes.set_ylim(*_frame(found, option, levels))
    _draw_region(axes, found, option)
    _draw_levels(axes, option, levels)
    _draw_limits_at_expiry(axes, option, market, found)
    mark_ex_times(axes, ex_times)
    label_axes(axes, option, "spot (money per unit of underlying)")


def limits_at_expiry(option: Option, market: Market) -> list[float]:
    """Return the ends of the exercise region as the time to expiry goes to 0, in money; none where there are events.

    Examples
    --------
    For a call with yield q > 0 the one end is K max(1, r/q) (Kim 1990):

    >>> market = Market(100.0, rate=0.06, volatility=0.2, dividend_yield=0.03)
    >>> [round(limit, 9) for limit in limits_at_expiry(Option("call", 100.0, 1.0), market)]
    [200.0]
    """
    only = _only_segment(option, market)
    if only is None or option.expiry == 0.0:
        return []
    ends = region_at_expiry(only, is_put=option.is_put).boundaries(option.strike, is_put=option.is_put)
    return [end for end in ends if math.isfinite(end)]


def _draw_curve(axes: Axes, time: Vector, boundary: Vector, label: str, style: str = "-") -> None:
    if np.isfinite(boundary).any():
        axes.plot(time, boundary, color=BLUE, linewidth=2.0, linestyle=style, label=label)
        alone = _alone(boundary)
        axes.plot(time[alone], boundary[alone], color=BLUE, linestyle="", marker="o")


def ex_times_of(option: Option, market: Market) -> list[float]:
    """Return the times of the dividends in the life of the option."""
    times = {one.time for one in market.cash_dividends} | {one.time for one in market.proportional_dividends}
    return sorted(time for time in times if 0.0 < time <= option.expiry)


def _in_pieces(found: ExerciseBoundary, option: Option, ex_times: list[float]) -> ExerciseBoundary:
    """Return the boundary with a gap after each ex-time, of a Bermudan option after every time."""
    ends = np.isin(found.time, ex_times) | (option.exercise == "bermudan")
    places = np.flatnonzero(ends[:-1]) + 1

    def parted(values: Vector) -> Vector:
        return np.insert(values, places, math.nan)

    return replace(
        found,
        time=np.insert(found.time, places, found.time[places - 1]),
        boundary=parted(found.boundary),
        other_boundary=None if found.other_boundary is None else parted(found.other_boundary),
    )


def _alone(boundary: Vector) -> BoolVector:
    """Return the points without neighbours: just before a dividend, or the dates of a Bermudan option."""
    known = np.pad(np.isfinite(boundary), 1)
    return np.asarray(known[1:-1] & ~known[:-2] & ~known[2:])


def _draw_region(axes: Axes, found: ExerciseBoundary, option: Option) -> None:
    """Shade the spots at which to exercise: to the other boundary, or to the edge of the frame."""
    bottom, top = axes.get_ylim()
    far = found.other_boundary
    if far is None:
        far = np.full(found.boundary.size, bottom if option.is_put else top)
    axes.fill_between(
        found.time, found.boundary, far, color=BLUE, alpha=0.12, linewidth=0.0, label="exercise"
    )
    alone = _alone(found.boundary)
    axes.vlines(found.time[alone], found.boundary[alone], far[alone], color=BLUE, alpha=0.3)


def _frame(found: ExerciseBoundary, option: Option, levels: list[float]) -> tuple[float, float]:
    """Return the least and the largest spot to show: every curve and level, and a margin."""
    curves = [found.boundary] if found.other_boundary is None else [found.boundary, found.other_boundary]
    values = np.concatenate([*curves, [option.strike], levels])
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    margin = 0.15 * max(most - least, 0.2 * option.strike)
    return max(least - margin, 0.0), most + margin


def _draw_levels(axes: Axes, option: Option, levels: list[float]) -> None:
    axes.axhline(option.strike, color=GREY, linewidth=1.0, linestyle="--", label=f"strike {option.strike:g}")
    for level in levels:
        axes.axhline(level, color=RED, linewidth=1.0, linestyle=":", label=f"perpetual level {level:.4g}")


def _perpetual_levels(option: Option, market: Market) -> list[float]:
    """Return the boundary of the option without expiry, if there is one and no event before the expiry."""
    now = _only_segment(option, market)
    if now is None or isinstance(market.volatility, LocalVolatility):
        return []
    level = option.strike * perpetual_boundary(
        is_put=option.is_put, rate=now.rate, dividend_yield=now.dividend_yield, volatility=now.volatility
    )
    return [level] if math.isfinite(level) and level > 0.0 else []


def _only_segment(option: Option, market: Market) -> Segment | None:
    """Return the life of an option that may be exercised at any time, and of whose market nothing changes."""
    book = Book.at_strike(option, market)
    only = book.segments_of()[0]
    return only if book.is_plain and only.exercisable else None


def _draw_limits_at_expiry(axes: Axes, option: Option, market: Market, found: ExerciseBoundary) -> None:
    """Mark and name the limits: in closed form without events, else those that the boundary reaches."""
    limits = limits_at_expiry(option, market)
    if not limits and found.time[-1] == option.expiry:
        ends = (
            [found.boundary[-1]]
            if found.other_boundary is None
            else [found.boundary[-1], found.other_boundary[-1]]
        )
        limits = [float(end) for end in ends if math.isfinite(end)]
    for limit in limits:
        label = f"limit at expiry {limit:.4g}"
        axes.plot(
            [option.expiry], [limit], color=RED, marker="o", linestyle="none", label=label, clip_on=False
        )


def mark_ex_times(axes: Axes, ex_times: list[float], *, named: bool = True) -> None:
    """Draw a line at each ex-time, and write the time at it where that is wanted and there is room."""
    for i, time in enumerate(ex_times):
        label = ("ex-date" if len(ex_times) == 1 else "ex-dates") if i == 0 else None
        axes.axvline(time, color=AMBER, linewidth=1.0, linestyle=(0, (2, 2)), label=label, zorder=0.5)
        if named and len(ex_times) <= MOST_NAMED:
            axes.annotate(
                f"{time:.3g}",
                (time, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, -3),
                textcoords="offset points",
                va="top",
                color=AMBER,
                fontsize=8,
            )


_KINDS = {PiecewiseConstant: "curve", LocalVolatility: "surface"}


def _describe(axes: Axes, option: Option, market: Market) -> None:
    axes.set_title(title_of(option, market))


def title_of(option: Option, market: Market) -> str:
    """Return the contract and its market in two lines."""
    curves = {"rate": market.rate, "yield": carry_yield(market), "volatility": market.volatility}
    terms = ", ".join(
        f"{name} {f'{curve:g}' if isinstance(curve, float) else _KINDS[type(curve)]}"
        for name, curve in curves.items()
    )
    if market.cash_dividends or market.proportional_dividends:
        terms += ", dividends"
    return f"{option.exercise.capitalize()} {option.option_type}, strike {option.strike:g}\n{terms}"


def label_axes(axes: Axes, option: Option, what: str) -> None:
    """Name the axes of a picture over the life of an option."""
    axes.set_xlabel("calendar time (years from now)")
    axes.set_ylabel(what)
    axes.set_xlim(0.0, max(option.expiry, 1e-9))
    axes.grid(color="#e3e7eb", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
