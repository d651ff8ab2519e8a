"""Ask when an option will be exercised, how likely that is, and what it costs to wait.

Run it from the root of the project: .venv/bin/python examples/07_exercise_advice.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pricing_core.american import CashDividend, Market, Option, exercise_advice, exercise_boundary, price

# A call in the money on a share that pays twice: it may be worth exercising just before an ex-date.
call = Option("call", strike=90.0, expiry=1.0)
market = Market(
    spot=100.0, rate=0.03, volatility=0.25, cash_dividends=[CashDividend(0.4, 2.5), CashDividend(0.9, 2.5)]
)
advice = exercise_advice(call, market)
print(f"exercise now: {advice.exercise_now}")
print(f"exercised some time before or at expiry with probability {advice.probability:.4f}")
before = 0.0
for time, cumulative in zip(advice.time, advice.cumulative_probability, strict=True):
    if cumulative - before > 1e-3:
        print(f"  at {time:.2f} with probability {cumulative - before:.4f}")
    before = cumulative

# Never to exercise early costs the early exercise premium.
found = price(call, market)
print(f"to wait for the expiry costs {advice.cost_of_waiting[-1]:.4f} of {found.price:.4f}")
assert abs(advice.cost_of_waiting[-1] - found.early_exercise_premium) < 1e-4
assert np.all(np.diff(advice.cumulative_probability) > -1e-12)

# Exercise before an ex-date is the event that the spot lies above the boundary there: a lognormal probability, for the
# first of them.
simulated = np.random.default_rng(1).standard_normal(400_000)
spot = 100.0 * np.exp((0.03 - 0.5 * 0.25**2) * 0.4 + 0.25 * np.sqrt(0.4) * simulated)
(at_first,) = exercise_boundary(call, market, [0.4]).boundary
share, known = np.mean(spot >= at_first), advice.cumulative_probability[np.searchsorted(advice.time, 0.4)]
print(f"before the first ex-date: {known:.4f}, and {share:.4f} of 400,000 simulated spots")
assert abs(share - known) < 4.0 * np.sqrt(known * (1.0 - known) / 400_000)

figure = Figure(figsize=(7.0, 4.0), layout="constrained")
axes = figure.subplots()
axes.step(advice.time, advice.cumulative_probability, where="post")
axes.set(
    xlabel="years from now",
    ylabel="probability",
    ylim=(0.0, 1.0),
    title="The call has been exercised by then",
)
target = Path(__file__).parent / "out" / "07_exercise_advice.png"
target.parent.mkdir(exist_ok=True)
figure.savefig(target, dpi=120)
