"""Price a call and a put on a share that pays four dividends, under rates that change, and see when to exercise.

Run it from the root of the project: .venv/bin/python examples/03_dividends_and_curves.py
"""

from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
    implied_volatility,
    price,
)

# Times are in years from now. The share pays 1.00 four times; by each ex-date its price falls by as much.
dividends = [CashDividend(time, amount=1.0) for time in (0.2, 0.45, 0.7, 0.95)]

# The rate is 3 % for half a year, and 5 % from then on.
rates = PiecewiseConstant(times=[0.5, 1.0], values=[0.03, 0.05])
market = Market(spot=100.0, rate=rates, volatility=0.25, cash_dividends=dividends)
call, put = Option("call", strike=95.0, expiry=1.0), Option("put", strike=105.0, expiry=1.0)

for option in (call, put):
    valuation = price(option, market)
    print(
        f"{option.option_type:4s} {valuation.price:8.4f} +- {valuation.error_estimate:.0e}, "
        f"of it early exercise {valuation.early_exercise_premium:6.4f}  ({valuation.method})"
    )
    # What the price changes by per 1.00 that a dividend grows by.
    print("     by dividend ", *(f"{change:8.4f}" for change in valuation.dividend_sensitivities or ()))

# At an ex-date the boundary is the one just before the dividend, which the call may be exercised to catch. Where there
# is no dividend to catch, no spot (nan) is worth exercising at. The put waits for the dividend instead.
times = [0.94, 0.95, 0.96]  # around the last ex-date
of_call, of_put = (exercise_boundary(option, market, times).boundary for option in (call, put))
for time, above, below in zip(times, of_call, of_put, strict=True):
    print(f"exercise at time {time}: the call from {above:5.2f}, the put up to {below:5.2f}")

# The volatility at which the put would cost 12.00.
found = implied_volatility(put, market, option_price=12.0)
print(f"put at 12.00: volatility {found.volatility:.4f}  ({found.status})")

# At that volatility the put does cost 12.00, and the parts of the price before and after an ex-date fit together.
again = price(put, Market(spot=100.0, rate=rates, volatility=found.volatility, cash_dividends=dividends))
assert abs(again.price - 12.0) <= 2.0 * again.error_estimate
assert str(of_call[0]) == str(of_call[2]) == str(of_put[1]) == "nan"
