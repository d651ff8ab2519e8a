"""The report on a fitted chain: one page of HTML with its pictures beside it; importing this imports matplotlib."""

import html
import io
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa

from app.commands.boundary_plot import AMBER, BLUE, DOTS_PER_INCH, GREY, RED, draw_boundary_on
from pricing_core.american import Option, exercise_boundary
from pricing_core.american.contracts.curves import integral
from pricing_core.american.implied.black_spread import black_spread
from pricing_core.chains import FLAGS, ChainFit
from pricing_core.chains.surface.smile_quotes import SmileQuotes
from pricing_core.errors import NumericalError
from pricing_core.extras import needs_extra
from pricing_core.replacement import replacement

with needs_extra("plot"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3  # pictures side by side; chosen
CURVE_POINTS = 201
WIDEST = 4.0  # standard deviations from the forward that are drawn; chosen
BOUNDARY_TOLERANCE = 1e-4  # of the boundaries, as a fraction of the strike: they are looked at


def write_report(folder: Path, fit: ChainFit, name: str) -> None:
    """Write report.html and its pictures into a folder."""
    pictures: dict[str, tuple[str, Callable[[ChainFit], Figure | None]]] = {
        "smiles": (
            "Smiles: bid to ask of every quote out of the money, puts red, calls blue, and the surface",
            draw_smiles,
        ),
        "total_variance": ("Total variance against log-moneyness, one line per expiry", draw_total_variance),
        "forward": ("Forwards, and the yield that they imply, with two standard errors", draw_forward),
        "boundaries": ("Exercise boundaries under the local volatility", draw_boundaries),
        "residuals": (
            "What quotes and pairs miss: model less mid, in half spreads; parity, in widths",
            draw_residuals,
        ),
    }
    shown = []
    for key, (title, draw) in pictures.items():
        figure = draw(fit)
        if figure is None:
            continue
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH)
        _write(folder / f"{key}.png", buffer.getvalue())
        shown.append(f'<h2>{html.escape(title)}</h2>\n<img src="{key}.png" alt="{html.escape(title)}">')
    _write(folder / "report.html", _page(fit, name, "\n".join(shown)).encode())


def draw_smiles(fit: ChainFit) -> Figure | None:
    """Draw the volatilities of every expiry."""
    expiries = [smile.expiry for smile in fit.smiles]
    if not expiries:
        return None
    rows = -(-len(expiries) // COLUMNS)
    figure = Figure(figsize=(4.2 * COLUMNS, 3.0 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    quotes = {
        name: np.array(fit.quotes[name].to_numpy(zero_copy_only=False), dtype=np.float64)
        for name in (
            "expiry",
            "strike",
            "bid_volatility",
            "ask_volatility",
            "mid_volatility",
            "european_price",
        )
    }
    is_call = np.array(fit.quotes["option_type"].to_pylist(), dtype=object) == "call"
    for place, smile in enumerate(fit.smiles):
        _draw_smile(axes[place], fit, place, quotes, is_call)
        axes[place].set_title(f"{365 * smile.expiry:.1f} days", fontsize=9)
    for unused in axes[len(expiries) :]:
        unused.set_visible(False)
    figure.supxlabel("strike (money)")
    figure.supylabel("volatility (1/sqrt(year))")
    return figure


def _draw_smile(
    axes: Axes, fit: ChainFit, place: int, quotes: dict[str, np.ndarray], is_call: np.ndarray
) -> None:
    smile = fit.smiles[place]
    here = quotes["expiry"] == smile.expiry
    out = here & (is_call == (quotes["strike"] >= smile.forward))  # the side out of the money
    for side, colour in ((is_call, BLUE), (~is_call, RED)):
        rows = np.flatnonzero(out & side & np.isfinite(quotes["mid_volatility"]))
        factor = _of_forward(
            fit, smile, {name: column[rows] for name, column in quotes.items()}, is_call[rows]
        )
        low = factor * np.nan_to_num(quotes["bid_volatility"][rows], nan=0.0)
        high = factor * quotes["ask_volatility"][rows]
        axes.vlines(quotes["strike"][rows], low, high, color=colour, linewidth=1.0)
    reach = WIDEST * float(np.median(smile.volatility)) * math.sqrt(smile.expiry)
    inside = smile.strike[np.abs(smile.log_moneyness) <= max(reach, 1e-3)]
    ends = (inside.min(), inside.max()) if inside.size else (smile.strike[0], smile.strike[-1])
    middle = smile.volatility[(smile.strike >= ends[0]) & (smile.strike <= ends[1])]
    if fit.surface is not None:
        strikes = np.linspace(*ends, CURVE_POINTS)
        axes.plot(strikes, fit.surface.volatility(strikes, smile.expiry), color=GREY, linewidth=1.0)
    margin = 0.02 * (ends[1] - ends[0]) or 1.0
    axes.set_xlim(ends[0] - margin, ends[1] + margin)
    axes.set_ylim(max(0.0, 0.8 * middle.min()), 1.15 * middle.max())
    axes.axvline(smile.forward, color=AMBER, linewidth=0.7, linestyle=":")
    axes.tick_params(labelsize=7)


def _of_forward(
    fit: ChainFit, smile: SmileQuotes, quotes: dict[str, np.ndarray], is_call: np.ndarray
) -> np.ndarray:
    """Return Black's volatilities of the forward over those in the table, which drop by dividends with the spot."""
    if not fit.market.cash_dividends:
        return np.ones(is_call.size)
    discount = math.exp(-integral(fit.market.rate, smile.expiry))
    strike, sign = quotes["strike"], np.where(is_call, 1.0, -1.0)
    with np.errstate(all="ignore"):
        payoff = np.maximum(sign * (smile.forward - strike), 0.0)
        value = (quotes["european_price"] / discount - payoff) / np.minimum(smile.forward, strike)
        spread = black_spread(np.abs(np.log(strike / smile.forward)), value)
        found = spread / math.sqrt(smile.expiry) / quotes["mid_volatility"]
    return np.where(np.isfinite(found), found, 1.0)


def _told(expiry: float) -> str:
    """Return the time to an expiry in days, or hours."""
    return f"{365.0 * expiry:.0f} d" if expiry >= 1.0 / 365.0 else f"{24.0 * 365.0 * expiry:.0f} h"


def draw_total_variance(fit: ChainFit) -> Figure | None:
    """Draw the total variances of the surface: where no lines cross there is no calendar arbitrage."""
    if fit.surface is None:
        return None
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes = figure.subplots()
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.9, len(fit.smiles)))
    for smile, colour in zip(fit.smiles, colours, strict=True):
        reach = WIDEST * float(np.median(smile.volatility)) * math.sqrt(smile.expiry)
        k = np.linspace(
            max(-reach, smile.log_moneyness[0]), min(reach, smile.log_moneyness[-1]), CURVE_POINTS
        )
        axes.plot(k, fit.surface.total_variance(k, smile.expiry), color=colour, label=_told(smile.expiry))
    axes.set_xlabel("ln(strike/forward)")
    axes.set_ylabel("volatility^2 * expiry")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=7, ncols=2, frameon=False)
    return figure


def draw_forward(fit: ChainFit) -> Figure | None:
    """Draw forwards and yields against time."""
    if not fit.carry.num_rows:
        return None
    expiry, forward, dividend_yield, error = (
        np.array(fit.carry[name].to_numpy(zero_copy_only=False), dtype=np.float64)
        for name in ("expiry", "forward", "dividend_yield", "standard_error")
    )
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(expiry, forward, "o", color=BLUE, markersize=3.0)
    if fit.surface is not None:
        ends = [each.time for each in fit.market.cash_dividends if each.time < expiry.max()]
        times = np.sort([*np.linspace(0.0, expiry.max(), CURVE_POINTS), *ends, *np.subtract(ends, 1e-6)])
        curve = [fit.surface.coordinates.forward(max(time, 0.0)) for time in times.tolist()]
        above.plot(times, curve, color=BLUE, linewidth=1.0)
    above.axhline(fit.market.spot, color=GREY, linewidth=0.8, linestyle="--")
    above.set_ylabel("forward (money)")
    for dividend in fit.market.cash_dividends:
        if dividend.time <= expiry.max():
            above.axvline(dividend.time, color=AMBER, linewidth=0.7, linestyle=":")
    below.errorbar(
        expiry, 1e4 * dividend_yield, 2e4 * np.nan_to_num(error), fmt="o", color=BLUE, markersize=3.0
    )
    sure = np.isfinite(error) & (error < 0.01) & (expiry >= 1.0 / 365.0)
    if sure.any():  # hours before an expiry the yield is hardly told: its bar goes on beyond the picture
        low, high = (1e4 * (dividend_yield + side * 2.0 * error)[sure] for side in (-1.0, 1.0))
        margin = 0.1 * (high.max() - low.min()) + 1.0
        below.set_ylim(low.min() - margin, high.max() + margin)
    below.set_ylabel("yield (basis points)")
    below.set_xlabel("expiry (years)")
    return figure


def draw_boundaries(fit: ChainFit) -> Figure | None:
    """Draw the exercise boundaries of a put at the money of a middle and of the last expiry."""
    if fit.local_volatility is None:
        return None
    chosen = [fit.smiles[place] for place in sorted({len(fit.smiles) // 2, len(fit.smiles) - 1})]
    figure = Figure(figsize=(8.0, 4.0 * len(chosen)), layout="constrained")
    for axes, smile in zip(figure.subplots(len(chosen), 1, squeeze=False).ravel(), chosen, strict=True):
        strike = float(smile.strike[np.argmin(np.abs(smile.log_moneyness))])
        option = Option("put", strike, smile.expiry)
        axes.set_title(f"put, strike {strike:g}, {365 * smile.expiry:.0f} days", fontsize=9)
        try:
            found = exercise_boundary(option, fit.market, tolerance=BOUNDARY_TOLERANCE)
        except NumericalError:
            continue
        if np.isfinite(found.boundary).any():
            draw_boundary_on(axes, found, option, fit.market)
    return figure


def draw_residuals(fit: ChainFit) -> Figure | None:
    """Draw the differences of quotes and model, and those of the pairs from parity."""
    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1)
    bid, ask, strike, expiry, model = (
        np.array(fit.quotes[name].to_numpy(zero_copy_only=False), dtype=np.float64)
        for name in ("bid", "ask", "strike", "expiry", "model_price")
    )
    with np.errstate(all="ignore"):
        miss = (model - 0.5 * (bid + ask)) / (0.5 * (ask - bid))
    rows = np.isfinite(miss)
    points = above.scatter(strike[rows], miss[rows], c=expiry[rows], s=4.0, cmap="viridis")
    figure.colorbar(points, ax=above, label="expiry (years)")
    above.axhspan(-1.0, 1.0, color=GREY, alpha=0.15)
    above.set_ylim(-4.0, 4.0)
    above.set_xlabel("strike (money)")
    above.set_ylabel("model less mid (half spreads)")
    pairs = {
        name: fit.pairs[name].to_numpy(zero_copy_only=False)
        for name in ("expiry", "residual", "width", "used")
    }
    for used, colour in ((True, BLUE), (False, RED)):
        kept = pairs["used"] == used
        if not kept.any():
            continue
        share = pairs["residual"][kept] / pairs["width"][kept]
        below.plot(
            pairs["expiry"][kept],
            share,
            "o",
            color=colour,
            markersize=3.0,
            label="used" if used else "left out",
        )
    below.set_xlabel("expiry (years)")
    below.set_ylabel("pair less parity (widths)")
    if fit.pairs.num_rows:
        below.legend(frameon=False, fontsize=8)
    return figure


def _page(fit: ChainFit, name: str, pictures: str) -> str:
    statuses = fit.quotes["status"].to_pylist()
    counted = {status: statuses.count(status) for status in dict.fromkeys(statuses)}
    flags = "".join(
        f"<tr><td>{key}</td><td>{count}</td><td>{FLAGS[key]}</td></tr>" for key, count in fit.flags.items()
    )
    unfitted = "".join(f"<li>{day}: {html.escape(why)}</li>" for day, why in fit.unfitted.items())
    shares = "there is no local volatility"
    if fit.local_volatility is not None:
        shares = f"{fit.share_within_before:.1%} before the correction, {fit.share_within_after:.1%} after it"
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Chain: {html.escape(name)}</title>
<style>body {{ font: 15px/1.4 sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem }}
img {{ max-width: 100% }} table {{ border-collapse: collapse }}
td, th {{ padding: 0.15rem 0.7rem; text-align: right; border-bottom: 1px solid #ddd }}
td:last-child {{ text-align: left }}</style></head><body>
<h1>{html.escape(name)}</h1>
<p>Valued at {fit.valuation}, spot {fit.market.spot:g}. {len(statuses)} quotes:
{", ".join(f"{count} {status}" for status, count in counted.items())}. Within bid and ask: {shares}.</p>
{f"<ul>{unfitted}</ul>" if unfitted else ""}
<h2>Flags</h2><table><tr><th>flag</th><th>rows</th><th>meaning</th></tr>{flags}</table>
<h2>Carry</h2>{_table(fit.carry)}
{pictures}
</body></html>
"""


def _table(table: pa.Table) -> str:
    head = "".join(f"<th>{name}</th>" for name in table.schema.names)
    rows = "".join(
        "<tr>" + "".join(f"<td>{_cell(value)}</td>" for value in row.values()) + "</tr>"
        for row in table.to_pylist()
    )
    return f"<table><tr>{head}</tr>{rows}</table>"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else html.escape(str(value))


def _write(path: Path, content: bytes) -> None:
    with replacement(path) as file:
        file.write(content)
