"""The picture of an advice on exercise, as PNG; importing this module imports matplotlib."""

import math
from pathlib import Path
from statistics import NormalDist

import numpy as np

from app.commands.boundary_plot import (
    AMBER,
    BLUE,
    DOTS_PER_INCH,
    GREY,
    RED,
    draw_boundary_on,
    ex_times_of,
    label_axes,
    mark_ex_times,
    title_of,
)
from pricing_core.american import ExerciseAdvice, Market, Option, exercise_boundary
from pricing_core.american.advice.density_march import DensityMarch
from pricing_core.american.advice.region import Span
from pricing_core.american.book.book import Book
from pricing_core.arrays import Matrix, Vector
from pricing_core.extras import needs_extra
from pricing_core.replacement import replacement

with needs_extra("plot"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FAN = (0.05, 0.25, 0.5, 0.75, 0.95)  # Quantiles of the spot that are drawn; chosen.
FAN_TIMES = 60  # Number of times between two events at which they are drawn; chosen.


def write_advice_plot(path: Path, advice: ExerciseAdvice, option: Option, market: Market) -> None:
    """Draw the boundary with the fan of spots, when the option is exercised, and what waiting costs."""
    figure = Figure(figsize=(8.0, 10.5), layout="constrained")
    spots, times, costs = figure.subplots(3, 1, sharex=True, height_ratios=[1.4, 1.0, 1.0])
    found = exercise_boundary(option, market)
    if np.isfinite(found.boundary).any():
        draw_boundary_on(spots, found, option, market)
    else:
        label_axes(spots, option, "spot (money per unit of underlying)")
        spots.axhline(option.strike, color=GREY, linewidth=1.0, linestyle="--", label="strike")
    _draw_fan(spots, option, market)
    spots.set_title(title_of(option, market) + f", spot {market.spot:g}")
    spots.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    _draw_times(times, advice, option, market)
    _draw_costs(costs, advice, option, market)
    for axes in (spots, times):
        axes.set_xlabel("")
    with replacement(path) as file:
        figure.savefig(file, format="png", dpi=DOTS_PER_INCH)


def _draw_times(axes: Axes, advice: ExerciseAdvice, option: Option, market: Market) -> None:
    axes.plot(
        *_from_now(advice.time, advice.cumulative_probability), color=BLUE, label="exercised early by then"
    )
    if advice.time[-1] == option.expiry:
        last = [option.expiry], [advice.assignment_probability[-1]]
        axes.plot(
            *last, color=AMBER, marker="o", linestyle="none", label="with exercise at expiry", clip_on=False
        )
    if math.isfinite(advice.expected_time):
        axes.axvline(
            advice.expected_time,
            color=RED,
            linewidth=1.0,
            linestyle=":",
            label=f"expected time of early exercise, {advice.expected_time:.3g} years",
        )
    mark_ex_times(axes, ex_times_of(option, market), named=False)
    label_axes(axes, option, "risk-neutral probability")
    axes.set_ylim(0.0, 1.0)
    axes.set_title(
        f"exercised early {advice.probability:.4g}, at expiry {advice.exercised_at_expiry:.4g}, "
        f"worthless {advice.expires_worthless:.4g}",
        fontsize=10,
    )
    axes.legend(loc="best", frameon=False, fontsize=8)


def _draw_costs(axes: Axes, advice: ExerciseAdvice, option: Option, market: Market) -> None:
    axes.plot(*_from_now(advice.time, advice.cost_of_waiting), color=BLUE)
    mark_ex_times(axes, ex_times_of(option, market), named=False)
    label_axes(axes, option, "cost of waiting (money today)")
    axes.set_ylim(bottom=0.0)
    axes.set_title(
        f"cost of waiting to expiry {advice.cost_of_waiting[-1]:.4g}"
        if advice.time[-1] == option.expiry
        else "cost of waiting",
        fontsize=10,
    )


def _from_now(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return the curve from time 0 on."""
    if time[0] == 0.0:
        return time, values
    return np.concatenate([[0.0], time]), np.concatenate([[0.0], values])


def _draw_fan(axes: Axes, option: Option, market: Market) -> None:
    """Draw quantiles of the spot of a holder who does not exercise."""
    time, spots = _fan(option, market)
    inner = len(FAN) // 2
    for i in range(inner):
        label = f"{FAN[i]:.0%} to {FAN[-1 - i]:.0%} of spots"
        axes.fill_between(time, spots[i], spots[-1 - i], color=GREY, alpha=0.12, linewidth=0.0, label=label)
    axes.plot(time, spots[inner], color=GREY, linewidth=1.0, label="median spot")
    axes.plot([0.0], [market.spot], color=GREY, marker="o", linestyle="none", label="spot now", clip_on=False)
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(min(bottom, float(spots[0].min())), 0.0), max(top, float(spots[-1].max())))


def _fan(option: Option, market: Market) -> tuple[Vector, Matrix]:
    """Return times, and the quantiles of the spot at each, shape (len(FAN), m).

    They are exact without dividends in cash, and close to it with them: what diffuses after one is taken to keep order.
    """
    book = Book.of([(option, market)])
    if book.local_terms() is not None:
        return _fan_on_grid(book)
    score = np.array([[NormalDist().inv_cdf(share)] for share in FAN])
    spot = np.full((len(FAN), 1), book.diffusing().item())
    variance = 0.0
    times, fan = [], []
    for segment in book.segments_of():
        since = np.linspace(0.0, segment.duration, FAN_TIMES + 1)
        drift = (segment.rate - segment.dividend_yield - 0.5 * segment.volatility**2) * since
        wide = np.sqrt(variance + segment.volatility**2 * since) - math.sqrt(variance)
        quantiles = spot * np.exp(drift + wide * score)
        escrow = np.array([segment.escrow_at(segment.start + x) for x in since.tolist()])
        times.append(segment.start + since)
        fan.append(quantiles + escrow)
        spot = np.maximum(quantiles[:, -1:] * (1.0 - segment.fraction) - segment.amount, 0.0)
        variance += segment.volatility**2 * segment.duration
    return np.concatenate(times), np.concatenate(fan, axis=1)


def _fan_on_grid(book: Book) -> tuple[Vector, Matrix]:
    """Return the same of a local volatility, from the density of the spot on a grid."""
    march, times, fan = DensityMarch(book, FAN_TIMES, 0.0, lambda: None), [], []
    march.count = 2  # steps of a part
    spots, segments = book.strike.item() * march.nodes, book.segments_of()
    for k, segment in enumerate(segments):
        ends = np.linspace(segment.start, segment.end, FAN_TIMES + 1)
        for i, time in enumerate(ends.tolist()):
            if i > 0:
                march.pass_through(segment, Span(ends.item(i - 1), time))
            below = np.cumsum(march.mass) - 0.5 * march.mass
            fan.append(np.interp(FAN, below / march.mass.sum(), spots) + segment.escrow_at(time))
        times.append(ends)
        if segment is not segments[-1]:
            march.pay(segment, k + 1)
    fan[0] = np.full(len(FAN), book.spot.item())
    return np.concatenate(times), np.array(fan).T
