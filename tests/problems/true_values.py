"""The reference tables of tests/data as rows."""

import csv
from dataclasses import dataclass
from pathlib import Path

from pricing_core.american import Market, Option

DATA = Path(__file__).parents[1] / "data"


@dataclass(frozen=True)
class TrueValue:
    name: str
    option: Option
    market: Market
    price: float
    reference_error: float  # fraction of the strike


@dataclass(frozen=True)
class TrueBoundary:
    name: str
    option: Option
    market: Market
    time_to_expiry: tuple[float, ...]
    boundary: tuple[float, ...]
    reference_error: float  # money


def rows_of(name: str) -> list[dict[str, str]]:
    with (DATA / name).open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def _contract(row: dict[str, str], option_type: str, spot: float) -> tuple[Option, Market]:
    rate, dividend_yield, volatility = (float(row[c]) for c in ("rate", "dividend_yield", "volatility"))
    option = Option(option_type, float(row["strike"]), float(row["expiry"]))
    return option, Market(spot, rate, volatility, dividend_yield)


def true_values() -> list[TrueValue]:
    return [
        TrueValue(
            f"{r['set']}-{r['option_type']}-K{r['strike']}-S{r['spot']}-T{r['expiry'][:5]}-sigma{r['volatility']}",
            *_contract(r, r["option_type"], float(r["spot"])),
            float(r["price"]),
            float(r["reference_error"]),
        )
        for r in rows_of("american_true_values.csv")
    ]


def true_boundaries() -> list[TrueBoundary]:
    rows = rows_of("exercise_boundaries.csv")
    result = []
    for name in dict.fromkeys(r["set"] for r in rows):
        mine = [r for r in rows if r["set"] == name]
        option, market = _contract(mine[0], "put", float(mine[0]["strike"]))
        kept = [r for r in mine if float(r["time_to_expiry"]) >= option.expiry / 10]
        result.append(
            TrueBoundary(
                name,
                option,
                market,
                tuple(float(r["time_to_expiry"]) for r in kept),
                tuple(float(r["boundary"]) for r in kept),
                float(mine[0]["reference_error"]),
            )
        )
    return result
