"""Price 20,000 contracts in columns by one call, and see that a row is priced as it would be alone.

Run it from the root of the project: .venv/bin/python examples/04_many_contracts.py
"""

import numpy as np

from pricing_core.american import Market, Option, price, price_many

rng = np.random.default_rng(7)
count = 20_000
columns = {
    "option_type": rng.choice(["put", "call"], count),
    "spot": 100.0,  # one number serves all rows
    "strike": rng.uniform(70.0, 140.0, count).round(1),
    "expiry": rng.uniform(0.05, 3.0, count),
    "rate": rng.uniform(0.0, 0.08, count),
    "dividend_yield": rng.uniform(0.0, 0.08, count),
    "volatility": rng.uniform(0.1, 0.6, count),
}

# A row that cannot be priced says why in its status and message, and leaves the others alone.
columns["volatility"][17] = -0.2

table = price_many(columns, tolerance=1e-5)
statuses, counts = np.unique(table["status"], return_counts=True)
for status, rows in zip(statuses, counts, strict=True):
    print(f"{status:14} {rows:6}")
print(f"row 17: {table['message'][17]}")
priced = table["status"] == "ok"
assert priced.sum() == count - 1
assert np.all(table["error_estimate"][priced] <= 1e-5 * columns["strike"][priced])

# Neighbours share vector registers, and change nothing: the same bits come out of one contract alone.
row = 4711
alone = price(
    Option(str(columns["option_type"][row]), columns["strike"][row], columns["expiry"][row]),
    Market(100.0, *(float(columns[name][row]) for name in ("rate", "volatility", "dividend_yield"))),
    tolerance=1e-5,
)
print(f"row {row}: {table['price'][row]:.17g} in the book, {alone.price:.17g} alone")
assert table["price"][row] == alone.price
