"""What the OpenAPI description says of /v1/chain."""

from typing import Any

from app.service.batch.answers import ARROW, JSON
from app.service.batch.row_limits import LONGEST_COLUMNS
from app.service.chain.fitting import CSV, MOST_QUOTES
from app.service.chain.question import PARAMETERS
from pricing_core.chains.canonical import COLUMNS

# By the kind of a canonical column: what its cells are.
KINDS = {
    "text": "Texts.",
    "number": "Numbers.",
    "moment": "ISO dates, or date-times in local time of the market.",
    "date": "ISO dates.",
    "option_type": "call, put, C or P.",
    "exercise": "american or european.",
}
EXAMPLE: dict[str, Any] = {
    "underlying_price": [100.0, 100.0],
    "quote_date": ["2026-03-02", "2026-03-02"],
    "expiration": ["2026-09-18", "2026-09-18"],
    "strike": [100.0, 100.0],
    "option_type": ["call", "put"],
    "bid": [8.09, 6.62],
    "ask": [8.14, 6.67],
}
BINARY = {"type": "string", "format": "binary"}
TABLE: dict[str, Any] = {"type": ["object", "null"], "additionalProperties": {"type": "array"}}
CHAIN_OPERATION: dict[str, Any] = {
    "parameters": PARAMETERS,
    "requestBody": {
        "required": True,
        "content": {
            JSON: {
                "schema": {
                    "type": "object",
                    "description": f"A list for each column, or a vendor's answer with a list of quotes; at most "
                    f"{LONGEST_COLUMNS:,} bytes and {MOST_QUOTES:,} quotes.",
                    "properties": {
                        name: {"type": "array", "description": KINDS[kind]} for name, kind in COLUMNS.items()
                    },
                    "examples": [EXAMPLE],
                }
            },
            CSV: {
                "schema": {"type": "string", "description": f"A header, and at most {MOST_QUOTES:,} lines."}
            },
            ARROW: {"schema": BINARY},
        },
    },
}
CHAIN_RESPONSE: dict[str, Any] = {
    "description": "The tables of the fit.",
    "content": {
        JSON: {
            "schema": {
                "type": "object",
                "properties": {
                    "quotes": TABLE,
                    "carry": TABLE,
                    "pairs": TABLE,
                    "dividends": TABLE,
                    "surface": TABLE,
                    "local_volatility": {"type": ["object", "null"]},
                    "flags": {"type": "object", "additionalProperties": {"type": "integer"}},
                    "unfitted": {"type": "object", "additionalProperties": {"type": "string"}},
                    "share_within_before": {"type": ["number", "null"]},
                    "share_within_after": {"type": ["number", "null"]},
                },
                "required": [
                    "quotes",
                    "carry",
                    "pairs",
                    "dividends",
                    "surface",
                    "local_volatility",
                    "flags",
                    "unfitted",
                ],
            }
        }
    },
}
