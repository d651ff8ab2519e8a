"""Write a morning's file of quotes as Cboe DataShop ships it, of a share that does not exist: seven expirations.

The spot diffuses with a displaced volatility, so that the smile falls; it pays two cash dividends that are known and a
yield of 0.8 % that is not. The quotes are American prices rounded outwards to cents, with a spread that grows with the
price; a few of them are crossed, one-sided or of an adjusted deliverable, as in any such file.

`python examples/chain/make_quotes.py` writes quotes.csv and dividends.csv into examples/out/chain/.
"""

import csv
import datetime as dt
from pathlib import Path

import numpy as np

from pricing_core.american import LocalVolatility, price_many

OUT = Path(__file__).parents[1] / "out" / "chain"
SEED = 20_261_124
DATE = dt.date(2026, 3, 2)
SPOT, RATE, DIVIDEND_YIELD = 187.43, 0.038, 0.008
DIVIDENDS = ((dt.date(2026, 5, 8), 0.9), (dt.date(2026, 8, 7), 0.9))
DAYS = (11, 25, 46, 74, 109, 200, 319)
LEVEL, SKEW = 0.27, 0.45  # volatility at the spot; the share of it that falls like 1/spot
WIDEST = 2.0  # standard deviations that strikes lie from the spot
HEADER = (
    "underlying_symbol,quote_date,root,expiration,strike,option_type,trade_volume,bid_size_1545,bid_1545,ask_size_1545,"
    "ask_1545,underlying_bid_1545,underlying_ask_1545,open_interest"
)


def years(day: dt.date) -> float:
    """Return the whole days to a date, in years."""
    return (day - DATE).days / 365.0


def local_volatility() -> LocalVolatility:
    """Return sigma(S) = level ((1 - skew) + skew S0 / S)."""
    spots = SPOT * np.exp(np.linspace(-1.5, 1.5, 61))
    row = LEVEL * ((1.0 - SKEW) + SKEW * SPOT / spots)
    return LocalVolatility([0.0, 1.0], spots, [row, row])


def strikes(expiry: float) -> np.ndarray:
    """Return strikes in steps of 2.5 or more, a dozen or two."""
    reach = WIDEST * LEVEL * np.sqrt(expiry)
    low, high = SPOT * np.exp(-reach), SPOT * np.exp(reach)
    step = 2.5 * max(1.0, np.ceil((high - low) / 2.5 / 20.0))
    return np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) * step


def contracts() -> list[dict]:
    """Return calls and puts of every expiration and strike."""
    found = []
    for days in DAYS:
        expiration = DATE + dt.timedelta(days=days)
        for strike in strikes(years(expiration)).tolist():
            found += [
                {"expiration": expiration, "strike": strike, "option_type": side} for side in ("call", "put")
            ]
    return found


def main() -> None:
    """Write both files."""
    rng = np.random.default_rng(SEED)
    rows = contracts()
    prices = price_many(
        {
            "option_type": [row["option_type"] for row in rows],
            "strike": [row["strike"] for row in rows],
            "expiry": [years(row["expiration"]) for row in rows],
            "spot": SPOT,
            "rate": RATE,
            "dividend_yield": DIVIDEND_YIELD,
            "cash_dividends": [{"time": years(day), "amount": amount} for day, amount in DIVIDENDS],
            "volatility": local_volatility(),
        },
        tolerance=1e-5,
        greeks="none",
    )["price"]
    half = 0.02 + 0.006 * prices
    bid = np.floor(100.0 * np.maximum(prices - half, 0.0)) / 100.0
    ask = np.ceil(100.0 * (prices + half)) / 100.0
    crossed, lonely = rng.choice(len(rows), 3, replace=False), rng.choice(len(rows), 4, replace=False)
    bid[crossed] = ask[crossed] + 0.05
    bid[lonely] = 0.0
    OUT.mkdir(parents=True, exist_ok=True)
    with (OUT / "quotes.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(HEADER.split(","))
        for row, low, high in zip(rows, bid.tolist(), ask.tolist(), strict=True):
            side = row["option_type"][0].upper()
            volume, interest, *sizes = rng.integers(1, 500, 4).tolist()
            contract = ["XYZ", DATE, "XYZ", row["expiration"], f"{row['strike']:.3f}", side]
            quote = [sizes[0], f"{low:.2f}", sizes[1], f"{high:.2f}", SPOT - 0.01, SPOT + 0.01]
            table.writerow([*contract, volume, *quote, interest])
    with (OUT / "dividends.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([("ex_date", "amount"), *DIVIDENDS])
    print(f"{len(rows)} quotes in {OUT / 'quotes.csv'}")


if __name__ == "__main__":
    main()
