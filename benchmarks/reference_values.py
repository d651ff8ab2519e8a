"""How far from the true values of 86 reference contracts is a price, what does it cost, and what does it claim?

"beyond" counts the prices with status "ok" whose error exceeds the tolerance all the same.

Takes about two minutes. Run from the root of the project: .venv/bin/python -m benchmarks.reference_values
"""

import csv
import platform
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import pricing_core
from pricing_core.american import Greeks, Market, Option, price

TABLE = Path(__file__).parents[1] / "tests" / "data" / "american_true_values.csv"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
REPEATS = 3


def contracts() -> list[tuple[Option, Market, float, float]]:
    """Return (option, market, true price, its own error as a fraction of the strike)."""
    with TABLE.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return [
        (
            Option(
                "put" if row["option_type"] == "put" else "call", float(row["strike"]), float(row["expiry"])
            ),
            Market(
                float(row["spot"]),
                float(row["rate"]),
                float(row["volatility"]),
                float(row["dividend_yield"]),
            ),
            float(row["price"]),
            float(row["reference_error"]),
        )
        for row in rows
    ]


class Priced(NamedTuple):
    """A price and what it claims, in strikes, whether its status is "ok", and the least of a few times."""

    price: float
    claim: float
    ok: bool
    milliseconds: float


def timed(option: Option, market: Market, tolerance: float, greeks: Greeks) -> Priced:
    """Price one contract a few times."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        valuation = price(option, market, tolerance=tolerance, greeks=greeks)
        times.append(1e3 * (time.perf_counter() - start))
    found, claim = valuation.price, valuation.error_estimate
    if found is None or claim is None:  # only a deadline does that
        raise ArithmeticError(f"{option} has no price: {valuation.status}")
    return Priced(found / option.strike, claim / option.strike, valuation.status == "ok", min(times))


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
            priced = timed(option, market, tolerance, greeks="none")
            errors.append(max(abs(priced.price - true / option.strike) - reference_error, 0.0))
            claims.append(priced.claim)
            ok += priced.ok
            beyond += priced.ok and errors[-1] > tolerance
            alone.append(priced.milliseconds)
            greeks.append(timed(option, market, tolerance, greeks="standard").milliseconds)
        accuracy = f"{tolerance:9.0e}  {max(errors):13.1e}  {np.sqrt(np.mean(np.square(errors))):9.1e}"
        claim = f"{np.median(claims):16.1e}  {ok:2d}/{len(table)}  {beyond:6d}"
        print(f"{accuracy}  {claim}  {np.mean(alone):13.1f}  {np.mean(greeks):14.1f}")


if __name__ == "__main__":
    main()
