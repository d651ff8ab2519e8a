"""Find the volatilities that American prices imply, with the error of each, and see when a price implies none.

Run it from the root of the project: .venv/bin/python examples/06_implied_volatility.py
"""

import numpy as np

from pricing_core.american import implied_volatility_many, price_many

strikes = np.linspace(80.0, 125.0, 10)
smile = 0.2 + 0.15 * np.log(strikes / 100.0) ** 2 - 0.1 * np.log(strikes / 100.0)
contracts = {
    "option_type": "put",
    "spot": 100.0,
    "strike": strikes,
    "expiry": 0.75,
    "rate": 0.04,
    "cash_dividends": [{"time": 0.25, "amount": 0.8}, {"time": 0.5, "amount": 0.8}],
}
prices = price_many(contracts | {"volatility": smile}, tolerance=1e-8, greeks="none")["price"]

found = implied_volatility_many(contracts, option_price=prices)
print("strike    price  volatility     error  off by")
for row in zip(strikes, prices, found["volatility"], found["volatility_error"], smile, strict=True):
    strike, option_price, volatility, error, true = row
    print(f"{strike:6.1f} {option_price:8.4f} {volatility:11.6f} {error:9.0e} {abs(volatility - true):7.0e}")
off = np.abs(found["volatility"] - smile)
# An estimate is no bound: it may be missed by a little.
assert np.all(off <= 2.0 * found["volatility_error"])
assert np.all(off < 2e-5)

# A put that is worth no more than its payoff is exercised at every small volatility: the price does not say which.
deep = implied_volatility_many(contracts | {"strike": [180.0], "cash_dividends": None}, option_price=[80.0])
print(f"a put at 180 for 80.00: {deep['status'][0]}")
assert deep["status"][0] == "not_identifiable"
