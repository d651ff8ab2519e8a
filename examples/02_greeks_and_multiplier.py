"""See what the solved complementarity problem says of a put: value, Greeks with their errors, boundary and multiplier.

The value V and the multiplier u of the holder's problem satisfy V_t + L V + u = 0 and 0 <= u _|_ V - payoff >= 0
(11.58): where the option is kept u is zero, and where it is exercised u is what waiting would cost, r K - q S a year.

Run it from the root of the project: .venv/bin/python examples/02_greeks_and_multiplier.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.american import Market, Option, price, value_surface

RATE, YIELD, VOLATILITY, STRIKE = 0.05, 0.02, 0.25, 100.0
option = Option("put", STRIKE, expiry=1.0)
market = Market(spot=95.0, rate=RATE, volatility=VOLATILITY, dividend_yield=YIELD)

# Every Greek comes from the solve that gave the price, with an estimate of its own error.
found = price(option, market, greeks="extended")
print(f"price        {found.price:10.5f}  +- {found.error_estimate:.0e}")
for name in ("delta", "gamma", "theta", "vega", "rho", "dividend_rho", "vanna", "volga", "charm"):
    print(f"{name:12} {getattr(found, name):10.5f}  +- {found.greek_errors[name]:.0e}")

# Where the option is kept its value obeys the Black-Scholes equation, so that theta follows from the other Greeks.
left = (
    found.theta
    + (RATE - YIELD) * market.spot * found.delta
    + 0.5 * (VOLATILITY * market.spot) ** 2 * found.gamma
    - RATE * found.price
)
print(f"residual of the Black-Scholes equation {left:.1e}")
assert abs(left) < 1e-9

# Now at many spots: the multiplier is positive exactly where the value is the payoff.
spots = np.linspace(60.0, 130.0, 281)
surface = value_surface(option, market, spots=spots, times=[0.0])
value, multiplier, exercised = surface.value[0], surface.multiplier[0], surface.exercised[0]
payoff = np.maximum(STRIKE - spots, 0.0)
assert np.all(multiplier[exercised] > 0.0)
assert np.all(multiplier[~exercised] == 0.0)
assert np.max(multiplier * (value - payoff)) < 1e-12
assert np.allclose(multiplier[exercised], (RATE * STRIKE - YIELD * spots)[exercised], atol=1e-9)
print(
    f"exercise at {found.exercise_boundary:.3f} and below; of {spots.size} spots {exercised.sum()} lie there"
)

figure = Figure(figsize=(7.0, 5.5), layout="constrained")
above, below = figure.subplots(2, sharex=True, height_ratios=[2, 1])
above.plot(spots, value, color="#0072B2", label="value V")
above.plot(spots, payoff, color="0.5", linestyle="--", linewidth=1.0, label="payoff")
below.plot(spots, multiplier, color="#D55E00")
above.set(ylabel="money", title="An American put: V = payoff where u > 0, and u = 0 elsewhere")
below.set(xlabel="spot", ylabel="multiplier u,\nmoney per year")
for axes in (above, below):
    axes.axvline(found.exercise_boundary, color="0.7", linewidth=0.8)
above.legend(frameon=False)
target = Path(__file__).parent / "out" / "02_greeks_and_multiplier.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
