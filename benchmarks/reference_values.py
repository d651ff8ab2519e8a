"""How far from the true values of 86 reference contracts is a price, what does it cost, and what does it claim?

"beyond" counts the prices with status "ok" whose error exceeds the tolerance all the same.

Takes about two minutes. Run from the root of the project: .venv/bin/python benchmarks/reference_values.py
"""

import csv
import platform
import time
from pathlib import Path

import numpy as np

import pricing_core
from pricing_core.american import Market, Option, Valuation, price

TABLE = Path(__file__).parents[1] / "tests" / "data" / "american_true_values.csv"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
REPEATS = 3


def contracts() -> list[tuple[Option, Market, float, float]]:
    """Return (option, market, true price, its own error as a fraction of the strike)."""
    with TABLE.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return [
        (
            Option(row["option_type"], float(row["strike"]), float(row["expiry"])),
            Market(*(float(row[name]) for name in ("spot", "rate", "volatility", "dividend_yield"))),
            float(row["price"]),
            float(row["reference_error"]),
        )
        for row in rows
    ]


def timed(option: Option, market: Market, tolerance: float, greeks: bool) -> tuple[Valuation, float]:
    """Return the valuation and the least of a few times, in milliseconds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        valuation = price(option, market, tolerance=tolerance, greeks=greeks)
        times.append(1e3 * (time.perf_counter() - start))
    return valuation, min(times)


def main() -> None:
    """Print one line per tolerance."""
    print(f"kernel {pricing_core.kernel_name()}, Python {platform.python_version()}, {platform.machine()}")
    print("errors as a fraction of the strike, less that of the reference; times per option on one core")
    print(
        "tolerance  largest error  rms error  claimed (median)  ok     beyond  ms price only  ms with Greeks"
    )
    table = contracts()
    for tolerance in TOLERANCES:
        errors, claims, alone, greeks, ok, beyond = [], [], [], [], 0, 0
        for option, market, true, reference_error in table:
            valuation, milliseconds = timed(option, market, tolerance, greeks=False)
            errors.append(max(abs(valuation.price - true) / option.strike - reference_error, 0.0))
            claims.append(valuation.error_estimate / option.strike)
            ok += valuation.status == "ok"
            beyond += valuation.status == "ok" and errors[-1] > tolerance
            alone.append(milliseconds)
            greeks.append(timed(option, market, tolerance, greeks=True)[1])
        accuracy = f"{tolerance:9.0e}  {max(errors):13.1e}  {np.sqrt(np.mean(np.square(errors))):9.1e}"
        claim = f"{np.median(claims):16.1e}  {ok:2d}/{len(table)}  {beyond:6d}"
        print(f"{accuracy}  {claim}  {np.mean(alone):13.1f}  {np.mean(greeks):14.1f}")


if __name__ == "__main__":
    main()
