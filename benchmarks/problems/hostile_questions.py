"""Questions to the service that take longer than almost any other."""

from typing import Any

# An implied volatility with 300 cash dividends and 300 proportional ones, to the smallest tolerance.
SEARCH: dict[str, Any] = {
    "option_type": "call",
    "spot": 60.0,
    "strike": 60.0,
    "expiry": 1.0,
    "rate": 0.02,
    "tolerance": 1e-8,
    "option_price": 5.0,
    "cash_dividends": [{"time": (k + 1) / 301, "amount": 0.01} for k in range(300)],
    "proportional_dividends": [{"time": (k + 1.5) / 301.5, "fraction": 0.0001} for k in range(300)],
}
