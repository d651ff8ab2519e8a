"""Write one small synthetic sample for each vendor's form; every one holds the same twelve quotes.

The quotes are American prices of a flat volatility of 25 %, at r = 4 % and q = 1 %, rounded outwards to cents. Columns
and traps are those of the vendors' public documentation; no number in these files comes from a vendor.
"""

import csv
import datetime as dt
import json
from pathlib import Path

from pricing_core.american import price_many

HERE = Path(__file__).parent
SPOT, DATE = 100.0, dt.date(2026, 3, 2)
EXPIRATIONS = (dt.date(2026, 4, 17), dt.date(2026, 9, 18))
STRIKES = (90.0, 100.0, 107.5)


def quotes() -> list[dict]:
    """Return the twelve quotes, by expiration, strike and side."""
    rows = [
        {"expiration": day, "strike": strike, "option_type": side}
        for day in EXPIRATIONS
        for strike in STRIKES
        for side in ("call", "put")
    ]
    columns = {
        "option_type": [row["option_type"] for row in rows],
        "strike": [row["strike"] for row in rows],
        "expiry": [(row["expiration"] - DATE).days / 365.0 for row in rows],
    }
    prices = price_many({**columns, "spot": SPOT, "rate": 0.04, "volatility": 0.25, "dividend_yield": 0.01})[
        "price"
    ]
    for place, (row, price) in enumerate(zip(rows, prices.tolist(), strict=True)):
        side = row["option_type"][0].upper()
        symbol = f"XYZ{row['expiration']:%y%m%d}{side}{round(row['strike'] * 1000):08d}"
        row |= {"symbol": symbol, "side": side, "bid": round(price - 0.02, 2), "ask": round(price + 0.03, 2)}
        row |= {"volume": 10 + place, "open_interest": 100 + place}
    return rows


def write_csv(name: str, rows: list[dict], header: list[str] | None = None) -> None:
    with (HERE / f"{name}.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header or list(rows[0]))
        table.writerows([*row.values()] for row in rows)


def write_json(name: str, content: object) -> None:
    (HERE / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")


def pairs(rows: list[dict]) -> list[tuple[dict, dict]]:
    return list(zip(rows[::2], rows[1::2], strict=True))


def main() -> None:
    rows = quotes()
    iso = DATE.isoformat()
    write_csv(
        "generic",
        [
            {
                "Underlying": "XYZ",
                "Spot": SPOT,
                "Date": iso,
                "Expiry": row["expiration"],
                "Strike": row["strike"],
                "CP": row["side"],
                "Bid": row["bid"],
                "Ask": row["ask"],
                "Volume": row["volume"],
                "Open Interest": row["open_interest"],
                "desk": "A",
            }
            for row in rows
        ],
    )
    write_json(
        "openbb",
        {
            "results": [
                {
                    "underlying_symbol": "XYZ",
                    "underlying_price": SPOT,
                    "contract_symbol": row["symbol"],
                    "eod_date": iso,
                    "dte": (row["expiration"] - DATE).days,
                    "expiration": row["expiration"].isoformat(),
                    "strike": row["strike"],
                    "option_type": row["option_type"],
                    "contract_size": 100,
                    "bid": row["bid"],
                    "ask": row["ask"],
                    "last_trade_price": None,
                    "volume": row["volume"],
                    "open_interest": row["open_interest"],
                    "implied_volatility": 0.25,
                }
                for row in rows
            ]
        },
    )
    write_csv(
        "cboe",
        [
            {
                "underlying_symbol": "XYZ",
                "quote_date": iso,
                "root": "XYZ",
                "expiration": row["expiration"],
                "strike": f"{row['strike']:.3f}",
                "option_type": row["side"],
                "open": 0,
                "high": 0,
                "low": 0,
                "close": 0,
                "trade_volume": row["volume"],
                "bid_size_1545": 12,
                "bid_1545": row["bid"],
                "ask_size_1545": 15,
                "ask_1545": row["ask"],
                "underlying_bid_1545": SPOT - 0.01,
                "underlying_ask_1545": SPOT + 0.01,
                "bid_size_eod": 0,
                "bid_eod": 0,
                "ask_size_eod": 0,
                "ask_eod": 0,
                "underlying_bid_eod": 0,
                "underlying_ask_eod": 0,
                "open_interest": row["open_interest"],
            }
            for row in rows
        ],
    )
    write_csv(
        "optionmetrics",
        [
            {
                "secid": 100001,
                "date": f"{DATE:%Y%m%d}",
                "exdate": f"{row['expiration']:%Y%m%d}",
                "cp_flag": row["side"],
                "strike_price": round(row["strike"] * 1000),
                "best_bid": row["bid"],
                "best_offer": row["ask"],
                "volume": row["volume"],
                "open_interest": row["open_interest"],
                "impl_volatility": "",
                "contract_size": 100,
                "am_settlement": 0,
            }
            for row in rows
        ],
    )
    write_csv(
        "orats",
        [
            {
                "ticker": "XYZ",
                "tradeDate": f"{DATE.month}/{DATE.day}/{DATE.year}",
                "stkPx": SPOT,
                "expirDate": f"{call['expiration'].month}/{call['expiration'].day}/{call['expiration'].year}",
                "yte": 0.126,
                "strike": call["strike"],
                "cVolu": call["volume"],
                "cOi": call["open_interest"],
                "pVolu": put["volume"],
                "pOi": put["open_interest"],
                "cBidPx": call["bid"],
                "cAskPx": call["ask"],
                "pBidPx": put["bid"],
                "pAskPx": put["ask"],
                "smoothSmvVol": 0.25,
                "iRate": 0.04,
                "divRate": 0.01,
                "residualRateData": 0.0,
            }
            for call, put in pairs(rows)
        ],
    )
    write_json(
        "polygon",
        {
            "status": "OK",
            "results": [
                {
                    "details": {
                        "contract_type": row["option_type"],
                        "exercise_style": "american",
                        "expiration_date": row["expiration"].isoformat(),
                        "shares_per_contract": 100,
                        "strike_price": row["strike"],
                        "ticker": f"O:{row['symbol']}",
                    },
                    "last_quote": {"bid": row["bid"], "ask": row["ask"], "bid_size": 12, "ask_size": 15},
                    "underlying_asset": {"price": SPOT, "ticker": "XYZ"},
                    "day": {"volume": row["volume"]},
                    "open_interest": row["open_interest"],
                    "greeks": {"delta": 0.5},
                    "implied_volatility": 0.25,
                }
                for row in rows
            ],
        },
    )
    write_json(
        "tradier",
        {
            "options": {
                "option": [
                    {
                        "symbol": row["symbol"],
                        "description": "XYZ",
                        "type": "option",
                        "root_symbol": "XYZ",
                        "underlying": "XYZ",
                        "strike": row["strike"],
                        "option_type": row["option_type"],
                        "expiration_date": row["expiration"].isoformat(),
                        "contract_size": 100,
                        "bid": row["bid"],
                        "ask": row["ask"],
                        "bidsize": 12,
                        "asksize": 15,
                        "last": None,
                        "volume": row["volume"],
                        "open_interest": row["open_interest"],
                        "greeks": {"bid_iv": 0.24, "mid_iv": 0.25, "phi": 0.0},
                    }
                    for row in rows
                ]
            }
        },
    )
    write_csv(
        "yfinance",
        [
            {
                "contractSymbol": row["symbol"],
                "lastTradeDate": "2026-02-27 20:59:00+00:00",
                "strike": row["strike"],
                "lastPrice": row["bid"],
                "bid": row["bid"],
                "ask": row["ask"],
                "change": 0.0,
                "percentChange": 0.0,
                "volume": row["volume"],
                "openInterest": row["open_interest"],
                "impliedVolatility": 0,
                "inTheMoney": False,
                "contractSize": "REGULAR",
                "currency": "USD",
            }
            for row in rows
        ],
    )
    write_csv(
        "thetadata",
        [
            {
                "root": "XYZ",
                "expiration": f"{row['expiration']:%Y%m%d}",
                "strike": round(row["strike"] * 1000),
                "right": row["side"],
                "ms_of_day": 57_600_000,
                "bid_size": 12,
                "bid": row["bid"],
                "ask_size": 15,
                "ask": row["ask"],
                "date": f"{DATE:%Y%m%d}",
                "underlying_price": SPOT,
            }
            for row in rows
        ],
    )
    write_csv(
        "ibkr",
        [
            {
                "symbol": "XYZ",
                "secType": "OPT",
                "lastTradeDateOrContractMonth": f"{row['expiration']:%Y%m%d}",
                "strike": row["strike"],
                "right": row["side"],
                "multiplier": "100",
                "exchange": "SMART",
                "currency": "USD",
                "bid": row["bid"],
                "ask": row["ask"],
                "bidSize": 12,
                "askSize": 15,
                "undPrice": SPOT,
                "impliedVol": 0.25,
            }
            for row in rows
        ],
    )
    names = [
        "QUOTE_UNIXTIME",
        "QUOTE_READTIME",
        "QUOTE_DATE",
        "UNDERLYING_LAST",
        "EXPIRE_DATE",
        "DTE",
        "C_IV",
        "C_VOLUME",
        "C_BID",
        "C_ASK",
        "STRIKE",
        "P_BID",
        "P_ASK",
        "P_IV",
        "P_VOLUME",
    ]
    header = [("" if place == 0 else " ") + f"[{name}]" for place, name in enumerate(names)]
    write_csv(
        "optionsdx",
        [
            {
                "unix": 1772485200,
                "read": f" {iso} 16:00",
                "date": f" {iso}",
                "spot": f" {SPOT}",
                "expire": f" {call['expiration']}",
                "dte": " 46.0",
                "c_iv": " 0.25",
                "c_volume": f" {call['volume']}",
                "c_bid": f" {call['bid']}",
                "c_ask": f" {call['ask']}",
                "strike": f" {call['strike']}",
                "p_bid": f" {put['bid']}",
                "p_ask": f" {put['ask']}",
                "p_iv": " ",
                "p_volume": f" {put['volume']}",
            }
            for call, put in pairs(rows)
        ],
        header,
    )


if __name__ == "__main__":
    main()
