"""The implied volatilities of bid, mid and ask, early exercise taken out, and those of a strike reconciled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.carry_pairs import DIVIDENDS
from pricing_core.american.implied.implied_volatility_many import implied_volatility_many
from pricing_core.arrays import BoolVector, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.quotes import Quotes

ROWS_AT_A_TIME = 2048  # between two looks at the interrupt; chosen
# Error of a volatility found at one volatility for all spots, as a share of what the early exercise premium is worth in
# volatility: by it the side with the smaller premium counts more; chosen.
PREMIUM_SHARE = 0.05
ENTERED = ("volatility", "bid_volatility", "ask_volatility", "european_price", "price")


@dataclass(frozen=True, slots=True, eq=False)
class QuoteVolatilities:
    """Volatilities of all rows of a chain; every array has shape (n,), NaN where there is none.

    Parameters
    ----------
    bid, mid, ask : Vector
        1/sqrt(year): at it an American option, or a European one where that is quoted, has that price.
    european_price, american_price : Vector
        At mid, money per unit of underlying.
    status : object array of str
        Status of the mid's volatility, as in `implied_volatility`; "invalid_input" without a sound bid and ask.
    """

    bid: Vector
    mid: Vector
    ask: Vector
    european_price: Vector
    american_price: Vector
    status: NDArray[np.object_]

    @property
    def deviation(self) -> Vector:
        """Half the difference of the volatilities of bid and ask.

        Where the bid has no volatility it is the difference of those of mid and ask in full.
        """
        half = 0.5 * (self.ask - self.bid)
        found: Vector = np.where(np.isfinite(half), half, self.ask - self.mid)
        return found


def quote_volatilities(
    quotes: Quotes,
    priceable: BoolVector,
    market: Market,
    dividend_yield: Vector,
    *,
    tolerance: float,
    threads: int | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> QuoteVolatilities:
    """Search the volatilities of the rows that have a sound bid, which may be 0, and ask.

    Parameters
    ----------
    priceable : bool array, shape (n,)
        Other rows have the status "invalid_input".
    market : Market
        Its rate and given dividends.
    dividend_yield : Vector, shape (n,)
        The yield up to each row's expiry, 1/year, as a constant.

    Raises
    ------
    NumericalError
        The interrupt came.
    """
    count = priceable.size
    table: dict[str, NDArray[Any]] = {name: np.full(count, np.nan) for name in ENTERED}
    table["status"] = np.full(count, "invalid_input", dtype=object)
    rows = np.flatnonzero(priceable)
    bid = np.nan_to_num(quotes.bid)
    # A column that is there is read row by row, even if it is empty.
    given = {name: value for name in DIVIDENDS if (value := getattr(market, name)) not in ((), "spot")}
    for start in range(0, rows.size, ROWS_AT_A_TIME):
        check_interrupt(interrupt)
        part = rows[start : start + ROWS_AT_A_TIME]
        found = implied_volatility_many(
            {
                "option_type": quotes.option_type[part],
                "exercise": quotes.exercise,
                "strike": quotes.strike[part],
                "expiry": quotes.expiry[part],
                "spot": quotes.spot,
                "rate": market.rate,
                "dividend_yield": dividend_yield[part],
                **given,
            },
            bid=bid[part],
            ask=quotes.ask[part],
            tolerance=tolerance,
            threads=threads,
        )
        for name in (*ENTERED, "status"):
            table[name][part] = found[name]
    return QuoteVolatilities(
        table["bid_volatility"],
        table["volatility"],
        table["ask_volatility"],
        table["european_price"],
        table["price"],
        table["status"],
    )


@dataclass(frozen=True, slots=True, eq=False)
class StrikeVolatilities:
    """One volatility per expiry and strike, m of them, in the order of both; every array has shape (m,).

    Parameters
    ----------
    expiry, strike : Vector
    volatility, deviation : Vector
        The mean of call and put by their weights, and its standard deviation.
    """

    expiry: Vector
    strike: Vector
    volatility: Vector
    deviation: Vector


def reconcile(
    quotes: Quotes, found: QuoteVolatilities, usable: BoolVector
) -> tuple[StrikeVolatilities, BoolVector]:
    """Return one volatility per strike, and which rows differ from the other side by more than both spreads.

    A quote counts by its spread and by a share of its early exercise premium in volatility: in the money the premium
    is large, and taking it out at one volatility for all spots is an approximation.
    """
    deviation = found.deviation
    good = usable & (found.status == "ok") & (deviation > 0.0) & np.isfinite(deviation) & (found.mid > 0.0)
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((quotes.strike[rows], quotes.expiry[rows]))]
    keys = np.stack([quotes.expiry[rows], quotes.strike[rows]])
    begins = np.append(True, np.any(np.diff(keys, axis=1) != 0.0, axis=0)) if rows.size else np.empty(0, bool)
    group = np.cumsum(begins) - 1
    count = int(begins.sum())
    error = np.hypot(deviation[rows], PREMIUM_SHARE * _premium_in_volatility(quotes, found, rows))
    weight = error**-2.0
    total = np.bincount(group, weight, count)
    volatility = np.bincount(group, weight * found.mid[rows], count) / total
    spread = np.sqrt(np.bincount(group, (weight * deviation[rows]) ** 2, count)) / total
    mismatch = np.zeros(good.size, dtype=bool)
    first = np.flatnonzero(begins)
    paired = first[np.bincount(group, minlength=count) == 2]
    call, put = rows[paired], rows[np.minimum(paired + 1, rows.size - 1)]
    apart = np.abs(found.mid[call] - found.mid[put]) > deviation[call] + deviation[put]
    mismatch[call[apart]] = mismatch[put[apart]] = True
    return StrikeVolatilities(keys[0, first], keys[1, first], volatility, spread), mismatch


def _premium_in_volatility(quotes: Quotes, found: QuoteVolatilities, rows: NDArray[np.intp]) -> Vector:
    """Return the early exercise premium divided by what the price gains with volatility."""
    premium = np.maximum(found.american_price[rows] - found.european_price[rows], 0.0)
    gained = 0.5 * (quotes.ask[rows] - np.nan_to_num(quotes.bid[rows]))
    return premium * found.deviation[rows] / np.maximum(gained, np.finfo(float).tiny)
