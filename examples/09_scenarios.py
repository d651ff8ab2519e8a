"""Make a book of contracts, value it under scenarios, and explain what it has gained or lost a day later.

A number behind it is how many contracts it makes: `.venv/bin/python examples/09_scenarios.py 10000`.

Run it from the root of the project: .venv/bin/python examples/09_scenarios.py
"""

import math
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pricing_core.batch import Scenario, explain_profit_and_loss, value_scenarios

OUT = Path(__file__).parent / "out"
SEED = 20_261_123
TOLERANCE = 1e-5
SHARES = 10
DAY = 1.0 / 365.0
SCENARIOS = (
    Scenario(-0.2, 0.15, -0.005, name="crash"),
    Scenario(-0.02, 0.01, name="bad day"),
    Scenario(0.02, -0.01, name="good day"),
    Scenario(rate_shift=0.01, name="rates up"),
    Scenario(days_forward=30.0, name="a month"),
)
PARTS = (
    *("delta_effect", "gamma_effect", "vega_effect", "theta_effect", "rho_effect"),
    *("dividend_effect", "exercise_effect", "residual"),
)


def book_of(rows: int) -> tuple[pa.Table, pa.Table]:
    """Return a book, and the same book a day later in another market."""
    rng = np.random.default_rng(SEED)
    spots = rng.uniform(20.0, 400.0, SHARES)
    later = spots * np.exp(0.015 * rng.standard_normal(SHARES))
    levels = rng.uniform(0.15, 0.45, SHARES)
    moves = 0.01 * rng.standard_normal(SHARES)
    # Three shares pay two dividends; the first of them is ex tomorrow.
    pays = [
        [(DAY if k == 0 else 0.1 * k, 0.01 * spots[k]), (0.5, 0.01 * spots[k])] if k < 3 else []
        for k in range(SHARES)
    ]
    later[0] -= pays[0][0][1]
    share = rng.integers(0, SHARES, rows)
    expiry = rng.choice([7, 30, 60, 91, 182, 365, 730], rows) / 365.0
    strike = spots[share] * np.round(np.exp(0.2 * rng.standard_normal(rows)), 2)
    smile = 0.1 * np.log(strike / spots[share]) ** 2
    terms = {
        "id": np.arange(rows),
        "desk": rng.choice(["income", "hedge", "growth"], rows),
        "share": [f"share {k}" for k in share],
        "quantity": rng.integers(-20, 21, rows),
        "contract_multiplier": np.full(rows, 100),
        "option_type": rng.choice(["put", "call"], rows),
        "strike": strike,
        "dividend_yield": np.where(share < 3, 0.0, 0.02),
    }
    before = terms | {
        "spot": spots[share],
        "expiry": expiry,
        "rate": np.full(rows, 0.04),
        "volatility": levels[share] + smile,
        "cash_dividends": dividends(pays, share, 0.0),
    }
    after = terms | {
        "spot": later[share],
        "expiry": expiry - DAY,
        "rate": np.full(rows, 0.0405),
        "volatility": levels[share] + moves[share] + smile,
        "cash_dividends": dividends(pays, share, DAY),
    }
    return pa.table(before), pa.table(after)


def dividends(pays: list[list[tuple[float, float]]], share: np.ndarray, passed: float) -> pa.Array:
    """Return the dividends still due of each contract's share."""
    due = [[{"time": t - passed, "amount": a} for t, a in listed if t > passed] for listed in pays]
    kind = pa.list_(pa.struct([("time", pa.float64()), ("amount", pa.float64())]))
    return pa.array([due[k] for k in share], kind)


def show_scenarios(book: pa.Table) -> float:
    """Print what each desk gains or loses in each scenario, and return the whole book's crash."""
    start = time.perf_counter()
    table = value_scenarios(book, scenarios=SCENARIOS, tolerance=TOLERANCE, share_solves=True, threads=2)
    pq.write_table(table, OUT / "scenarios.parquet")
    groups = value_scenarios(book, scenarios=SCENARIOS, group_by=["desk"], tolerance=TOLERANCE, threads=2)
    print(f"profit and loss in thousands, {table.num_rows} rows ({time.perf_counter() - start:.0f} s)")
    print(" " * 10 + "".join(f"{scenario.name:>12}" for scenario in SCENARIOS))
    rows = groups.to_pylist()
    for desk in sorted({row["desk"] for row in rows}):
        found = {row["scenario"]: row["profit_and_loss"] for row in rows if row["desk"] == desk}
        print(f"{desk:10}" + "".join(f"{found[scenario.name] / 1e3:12.1f}" for scenario in SCENARIOS))
    return float(sum(row["profit_and_loss"] for row in rows if row["scenario"] == "crash"))


def show_explanation(before: pa.Table, after: pa.Table) -> dict[str, float]:
    """Print what the book has gained or lost in a day, by causes, and return it."""
    start = time.perf_counter()
    table = explain_profit_and_loss(before, after, tolerance=TOLERANCE, threads=2)
    pq.write_table(table, OUT / "explained.parquet")
    held = pc.multiply(pc.cast(before["quantity"], pa.float64()), 100.0)
    found = {name: pc.sum(pc.multiply(table[name], held)).as_py() for name in ("profit_and_loss", *PARTS)}
    print(f"a day later, in thousands ({time.perf_counter() - start:.0f} s)")
    for name, amount in found.items():
        print(f"    {name:16}{amount / 1e3:10.2f}")
    return found


def main(rows: int = 300) -> tuple[float, dict[str, float]]:
    """Write a book, its scenarios and its explanation into examples/out, and return the headlines."""
    OUT.mkdir(exist_ok=True)
    before, after = book_of(rows)
    pq.write_table(before, OUT / "generated_book.parquet")
    crash = show_scenarios(before)
    day = show_explanation(before, after)
    causes = [day[name] for name in PARTS]
    assert math.isclose(sum(causes), day["profit_and_loss"], rel_tol=1e-9)
    assert abs(day["residual"]) < 0.01 * sum(map(abs, causes))
    return crash, day


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
