"""Fit a morning's chain of quotes: the yield it implies, volatilities, and a surface that reprices the quotes.

The quotes are those of `examples/chain/make_quotes.py`, of a share that does not exist; so the truth is known.

Run it from the root of the project: .venv/bin/python examples/08_chain_of_quotes.py
"""

import runpy
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
from matplotlib.figure import Figure

from pricing_core.chains import fit_chain, read_chain
from pricing_core.chains.side_files import read_dividends

HERE = Path(__file__).parent
made = runpy.run_path(str(HERE / "chain" / "make_quotes.py"))
made["main"]()
quotes = read_chain(HERE / "out" / "chain" / "quotes.csv")
dividends = read_dividends(str(HERE / "out" / "chain" / "dividends.csv"))

fit = fit_chain(quotes, made["RATE"], cash_dividends=dividends)
print(f"left out: {', '.join(f'{count} {flag}' for flag, count in fit.flags.items())}")
print("days   yield  standard error")
implied, errors = (fit.carry[name].to_numpy() for name in ("dividend_yield", "standard_error"))
for days, found, error in zip(made["DAYS"], implied, errors, strict=True):
    print(f"{days:4} {found:7.4%} {error:8.4%}")
print(f"the model's prices lie within bid and ask for {fit.share_within_after:.1%} of the quotes")
assert np.all(np.abs(implied - made["DIVIDEND_YIELD"]) < 3.0 * errors)
assert fit.share_within_after >= 0.99

# How far the model's prices are from the middle of bid and ask, in halves of the spread between them.
table = fit.quotes.filter((pc.field("status") == "ok") & (pc.field("ask") > pc.field("bid")))
columns = ("expiry", "strike", "bid", "ask", "model_price")
expiry, strike, bid, ask, price = (table[name].to_numpy() for name in columns)
off = (2.0 * price - bid - ask) / (ask - bid)
figure = Figure(figsize=(7.0, 4.5), layout="constrained")
axes = figure.subplots()
for years in np.unique(expiry):
    axes.plot(strike[expiry == years], off[expiry == years], ".", label=f"{365 * years:.0f} days")
for edge, name in ((-1.0, "bid"), (1.0, "ask")):
    axes.axhline(edge, color="0.6", linewidth=0.8)
    axes.annotate(name, (strike.max(), edge), va="bottom", ha="right", color="0.4")
axes.set(xlabel="strike", ylabel="model price, from the middle", title="The American quotes are repriced")
axes.legend(frameon=False, ncols=4, loc="upper left")
axes.set_ylim(-1.6, 2.2)
target = HERE / "out" / "08_chain_of_quotes.png"
figure.savefig(target, dpi=120)
