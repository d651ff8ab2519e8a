"""What a chain of quotes has been fitted to: tables, a surface and a local volatility."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import Vector
from pricing_core.chains.canonical import MESSAGE
from pricing_core.chains.carry import Carry
from pricing_core.chains.expiry_time import Moment
from pricing_core.chains.implied_dividends import ImpliedDividends
from pricing_core.chains.quotes import Quotes
from pricing_core.chains.surface.implied_surface import ImpliedSurface
from pricing_core.chains.surface.smile_quotes import SmileQuotes
from pricing_core.chains.surfaces import Fitted
from pricing_core.chains.volatilities import QuoteVolatilities

OK = "ok"
NOT_FITTED = "surface: no usable volatility"


@dataclass(frozen=True, slots=True, eq=False)
class ChainFit:
    """The result of `fit_chain`.

    Parameters
    ----------
    quotes : pyarrow.Table
        Every row of the input in order: its columns, then expiry (years), bid_volatility, mid_volatility,
        ask_volatility (1/sqrt(year), early exercise taken out), european_price (at mid_volatility); of the surface
        model_volatility (Black's of the forward), under the local volatility model_price, each with its standard error
        in model_volatility_error and model_price_error; status (of mid_volatility, as `implied_volatility` has it) and
        flags (words with commas between them, see `FLAGS`).
    carry : pyarrow.Table
        By expiration: expiration, expiry, forward, dividend_yield (the mean up to it, continuous, on top of the
        dividends that are given), standard_error (of the yield), residual (money), pairs_used, status.
    pairs : pyarrow.Table
        Every call and put that the carry was looked for in: expiry, strike, residual (what they miss parity by, money),
        width (of their quotes, money) and used.
    dividends : pyarrow.Table
        The cash dividends of the market: time (years), amount (money) and, where it is implied, its standard_error.
    flags : mapping of str to int
        How many rows have each flag.
    market : Market
        Spot, rate, fitted yield curve, given dividends; with the local volatility where there is one.
    valuation : date or datetime
    smiles : tuple of SmileQuotes
        What the surface was fitted to.
    surface : ImpliedSurface, optional
        None where no expiry could be fitted; `surface_message` says why.
    local_volatility : LocalVolatility, optional
        With which American prices of `market` meet the quotes.
    share_within_before, share_within_after : float
        Share of the usable quotes of the fitted expiries whose model price lies within bid and ask, before
        and after the correction of the local volatility by the American quotes; NaN without a local volatility.
    """

    quotes: pa.Table
    carry: pa.Table
    pairs: pa.Table
    dividends: pa.Table
    flags: Mapping[str, int]
    market: Market
    valuation: Moment
    smiles: tuple[SmileQuotes, ...] = ()
    surface: ImpliedSurface | None = None
    local_volatility: LocalVolatility | None = None
    share_within_before: float = float("nan")
    share_within_after: float = float("nan")
    surface_message: str = field(default="")

    @property
    def unfitted(self) -> dict[str, str]:
        """The expirations without a carry of their own or without a smile, and why."""
        carried = zip(
            *(self.carry[name].to_pylist() for name in ("expiration", "expiry", "status")), strict=True
        )
        smiles = {} if self.surface is None else {one.expiry: one for one in self.surface.statuses}
        found = {}
        for expiration, expiry, status in carried:
            smile = smiles.get(expiry)
            if status != OK:
                found[str(expiration)] = f"carry: {status}"
            elif smile is None:
                found[str(expiration)] = self.surface_message or NOT_FITTED
            elif smile.status == "invalid_input":
                found[str(expiration)] = f"surface: {smile.message}"
        return found

    @property
    def rejected(self) -> int:
        """How many rows could not be read."""
        return self.flags.get("unreadable", 0)


def quotes_table(quotes: Quotes, found: QuoteVolatilities, fitted: Fitted, flags: list[str]) -> pa.Table:
    """Return every row with its results; missing numbers are null."""
    table = quotes.table
    messages, nothing = table[MESSAGE], np.full(quotes.strike.size, np.nan)
    table = table.drop_columns([MESSAGE])
    results = {
        "expiry": quotes.expiry,
        "bid_volatility": found.bid,
        "mid_volatility": found.mid,
        "ask_volatility": found.ask,
        "european_price": found.european_price,
        **_model_volatilities(quotes, fitted),
        "model_price": fitted.model_price,
        "model_price_error": nothing if fitted.price_error is None else fitted.price_error,
    }
    clashing = [name for name in (*results, "status", "flags") if name in table.schema.names]
    table = table.drop_columns(clashing)  # results of an earlier fit
    for name, column in results.items():
        table = table.append_column(name, numbers(column))
    table = table.append_column("status", pa.array(found.status.tolist(), pa.string()))
    table = table.append_column("flags", pa.array(flags, pa.string()))
    return table.append_column(MESSAGE, messages)


def _model_volatilities(quotes: Quotes, fitted: Fitted) -> dict[str, Vector]:
    """Return the surface's volatilities at the quotes that have a model price, and their standard errors."""
    value, error = (np.full(quotes.strike.size, np.nan) for _ in range(2))
    priced = np.isfinite(fitted.model_price)
    for expiry in np.unique(quotes.expiry[priced]).tolist():
        assert fitted.surface is not None
        rows = priced & (quotes.expiry == expiry)
        value[rows] = fitted.surface.volatility(quotes.strike[rows], expiry)
        error[rows] = fitted.surface.standard_error(quotes.strike[rows], expiry)
    return {"model_volatility": value, "model_volatility_error": error}


def carry_table(quotes: Quotes, carry: Carry) -> pa.Table:
    """Return the carry by expiration."""
    pairs = zip(quotes.column("expiration"), quotes.expiry.tolist(), quotes.readable.tolist(), strict=True)
    found = {day: expiry for day, expiry, readable in pairs if readable and day is not None}
    days = [day for day in sorted(found) if found[day] in set(carry.expiry.tolist())]
    rows = np.searchsorted(carry.expiry, [found[day] for day in days]).astype(np.intp)
    return pa.table(
        {
            "expiration": pa.array(days, pa.date32()),
            "expiry": numbers(carry.expiry[rows]),
            "forward": numbers(carry.forward[rows]),
            "dividend_yield": numbers(carry.dividend_yield[rows]),
            "standard_error": numbers(carry.standard_error[rows]),
            "residual": numbers(carry.residual[rows]),
            "pairs_used": pa.array(carry.pairs_used[rows], pa.int64()),
            "status": pa.array(carry.status[rows].tolist(), pa.string()),
        }
    )


def pairs_table(carry: Carry) -> pa.Table:
    """Return the pairs of calls and puts."""
    nothing = np.empty(0)
    pairs = carry.pairs
    expiry, strike, width = (pairs.expiry, pairs.strike, pairs.width) if pairs is not None else (nothing,) * 3
    columns = {"expiry": expiry, "strike": strike, "residual": carry.pair_residual, "width": width}
    table = {name: numbers(column) for name, column in columns.items()}
    return pa.table({**table, "used": pa.array(carry.pair_used, pa.bool_())})


def dividends_table(market: Market, implied: ImpliedDividends) -> pa.Table:
    """Return the cash dividends of a market, some of them implied."""
    errors = dict(zip(implied.time.tolist(), implied.standard_error.tolist(), strict=True))
    dividends = market.cash_dividends
    columns = {
        "time": [each.time for each in dividends],
        "amount": [each.amount for each in dividends],
        "standard_error": [errors.get(each.time) for each in dividends],
    }
    return pa.table({name: pa.array(column, pa.float64()) for name, column in columns.items()})


def numbers(column: Vector) -> pa.Array:
    """Return a column of numbers, null where there is none."""
    return pa.array(column, pa.float64(), from_pandas=True)
