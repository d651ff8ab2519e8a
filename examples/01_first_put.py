"""Price one American put, see what early exercise is worth, and find when to exercise.

Run it from the root of the project: .venv/bin/python examples/01_first_put.py
"""

from pricing_core.american import Market, Option, exercise_boundary, price

# The right to sell one share for 100 at any time within the next year.
option = Option("put", strike=100.0, expiry=1.0)

# The share costs 100 now. Rates are per year and continuously compounded: 0.05 is 5 %.
market = Market(spot=100.0, rate=0.05, volatility=0.2, dividend_yield=0.0)

# The tolerance is the error allowed in the price, as a fraction of the strike: here 1e-6 * 100 = 0.0001.
valuation = price(option, market, tolerance=1e-6)

print(f"American put   {valuation.price:9.4f}  +- {valuation.error_estimate:.1e}  ({valuation.status})")
print(f"European put   {valuation.european_price:9.4f}")
print(f"early exercise {valuation.early_exercise_premium:9.4f}")

# delta and gamma are per unit of money of the spot; theta per day is money per calendar day.
print(
    f"delta {valuation.delta:.4f}, gamma {valuation.gamma:.5f}, theta per day {valuation.theta_per_day:.5f}"
)

# The holder does best to exercise once the share falls to the boundary, which rises to the strike at expiry.
boundary = exercise_boundary(option, market, times=[0.0, 0.5, 0.9, 1.0])
for time, spot in zip(boundary.time, boundary.boundary, strict=True):
    print(f"exercise at time {time:.1f} if the share costs at most {spot:6.2f}")

# The value to seven digits, of tests/data/american_true_values.csv.
assert abs(valuation.price - 6.090371) <= valuation.error_estimate
