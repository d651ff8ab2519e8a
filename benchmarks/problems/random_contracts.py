"""Random contracts with and without events, as rows that `contract_from` takes: one function for each kind."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np

from benchmarks.problems.portfolios import STRIKE

Row: TypeAlias = dict[str, Any]
DividendKind: TypeAlias = Literal["cash", "proportional", "mixed"]
Kind: TypeAlias = Callable[[np.random.Generator], Row]
HOUR = 1.0 / (24 * 365)  # year
QUARTER, WEEK = 0.25, 1.0 / 52.0  # years


def rows_of(kind: Kind, count: int, seed: int = 8) -> list[Row]:
    """Return so many contracts of a kind, the same ones at every call."""
    random = np.random.default_rng(seed)
    return [kind(random) for _ in range(count)]


def flat(random: np.random.Generator) -> Row:
    """Return a contract without events, rate and yield at least 0."""
    return {
        "option_type": str(random.choice(["put", "call"])),
        "spot": random.uniform(70.0, 140.0),
        "strike": STRIKE,
        "expiry": random.uniform(0.1, 3.0),
        "rate": random.uniform(0.005, 0.08),
        "dividend_yield": random.uniform(0.0, 0.08),
        "volatility": random.uniform(0.1, 0.6),
        "cash_dividends": [],
        "proportional_dividends": [],
    }


def rate_near_yield(random: np.random.Generator) -> Row:
    """Return a contract without events whose rate and yield are less than 0.002 apart."""
    row = flat(random)
    return {**row, "dividend_yield": row["rate"] + random.uniform(-0.002, 0.002)}


def paying(
    row: Row,
    times: list[float],
    random: np.random.Generator,
    kind: DividendKind = "cash",
    size: tuple[float, float] = (0.002, 0.02),
) -> Row:
    """Return the contract with dividends at these times, each a random fraction of the spot now."""
    sizes = random.uniform(*size, len(times)).tolist()
    in_cash = [kind == "cash" or (kind == "mixed" and k % 2 == 0) for k in range(len(times))]
    listed = list(zip(times, sizes, in_cash, strict=True))
    cash = [{"time": time, "amount": size * row["spot"]} for time, size, cash in listed if cash]
    fractions = [{"time": time, "fraction": size} for time, size, cash in listed if not cash]
    return {**row, "cash_dividends": cash, "proportional_dividends": fractions}


def spread_out(row: Row, count: int, random: np.random.Generator) -> list[float]:
    """Return so many times before expiry, one in each equal part of the contract's life."""
    parts = np.arange(count) + random.uniform(0.1, 0.9, count)
    return [float(row["expiry"] * part / count) for part in parts]


def every(row: Row, period: float, random: np.random.Generator) -> list[float]:
    """Return the times before expiry of dividends with this period in years."""
    return np.arange(random.uniform(0.0, period), row["expiry"], period).tolist()


def cash(random: np.random.Generator) -> Row:
    """Return a contract with one or four cash dividends."""
    row = flat(random)
    return paying(row, spread_out(row, int(random.choice([1, 4])), random), random)


def proportional(random: np.random.Generator) -> Row:
    """Return a contract with one or four proportional dividends."""
    row = flat(random)
    return paying(row, spread_out(row, int(random.choice([1, 4])), random), random, "proportional")


def mixed(random: np.random.Generator) -> Row:
    """Return a contract with two cash and two proportional dividends."""
    row = flat(random)
    return paying(row, spread_out(row, 4, random), random, "mixed")


def escrowed(random: np.random.Generator) -> Row:
    """Return a contract with one or four cash dividends in escrow."""
    return {**cash(random), "dividend_model": "escrowed"}


def curve(row: Row, least: float, most: float, random: np.random.Generator) -> dict[str, list[float]]:
    """Return a curve of three random values that ends after expiry."""
    return {
        "times": [*spread_out(row, 2, random), row["expiry"] + 0.1],
        "values": random.uniform(least, most, 3).tolist(),
    }


def curves(random: np.random.Generator) -> Row:
    """Return a contract with curves of rate, yield and volatility, and one cash dividend."""
    row = flat(random)
    low, high = 0.7 * row["volatility"], 1.3 * row["volatility"]
    given = {
        "rate": curve(row, 0.005, 0.08, random),
        "dividend_yield": curve(row, 0.0, 0.08, random),
        "volatility": curve(row, low, high, random),
    }
    return paying({**row, **given}, spread_out(row, 1, random), random)


def near_the_money(row: Row, hours: float, random: np.random.Generator) -> Row:
    """Return the contract with so many hours to expiry, and within two standard deviations of the strike."""
    expiry = hours * HOUR
    spread = row["volatility"] * np.sqrt(expiry)
    return {**row, "expiry": expiry, "spot": STRIKE * float(np.exp(spread * random.uniform(-2.0, 2.0)))}


def hours_to_expiry(random: np.random.Generator) -> Row:
    """Return a contract without events, 1 to 48 hours before expiry."""
    return near_the_money(flat(random), random.uniform(1.0, 48.0), random)


def hours_to_expiry_and_ex_date(random: np.random.Generator) -> Row:
    """Return a contract with a cash dividend, both within 1 to 48 hours."""
    row = hours_to_expiry(random)
    return paying(row, spread_out(row, 1, random), random)


def hours_to_ex_date(random: np.random.Generator) -> Row:
    """Return a contract with two cash dividends, the first within 1 to 48 hours."""
    row = flat(random)
    return paying(row, [random.uniform(1.0, 48.0) * HOUR, 0.6 * row["expiry"]], random)


def near_yield_with_cash(random: np.random.Generator) -> Row:
    """Return a contract with two cash dividends whose rate and yield are less than 0.002 apart."""
    row = rate_near_yield(random)
    return paying(row, spread_out(row, 2, random), random)


def two_boundaries(random: np.random.Generator) -> Row:
    """Return a contract whose exercise region has two boundaries: negative rate and yield."""
    row, near, far = flat(random), -random.uniform(0.01, 0.03), -random.uniform(0.04, 0.06)
    low, high = (near, far) if row["option_type"] == "put" else (far, near)
    return {**row, "rate": low, "dividend_yield": high}


def two_boundaries_with_cash(random: np.random.Generator) -> Row:
    """Return a contract whose exercise region has two boundaries, with a cash dividend."""
    row = two_boundaries(random)
    return paying(row, spread_out(row, 1, random), random)


def quarterly(random: np.random.Generator) -> Row:
    """Return a contract of two to ten years with a cash dividend each quarter."""
    row = {**flat(random), "expiry": random.uniform(2.0, 10.0)}
    return paying(row, every(row, QUARTER, random), random)


def volatile(random: np.random.Generator) -> Row:
    """Return a contract with a volatility of 80 to 150 % and four cash dividends."""
    row = {**flat(random), "volatility": random.uniform(0.8, 1.5)}
    return paying(row, spread_out(row, 4, random), random)


def special(random: np.random.Generator) -> Row:
    """Return a contract with one cash dividend of 20 to 50 % of the spot."""
    row = flat(random)
    return paying(row, spread_out(row, 1, random), random, size=(0.2, 0.5))


def annual(random: np.random.Generator) -> Row:
    """Return a contract of one to five years with a cash dividend of about a tenth of the spot each year."""
    row = {**flat(random), "expiry": random.uniform(1.0, 5.0)}
    return paying(row, every(row, 1.0, random), random, size=(0.08, 0.12))


def steep_curves(random: np.random.Generator) -> Row:
    """Return a contract with curves that jump far, and two cash dividends."""
    row = flat(random)
    given = {
        "rate": curve(row, 0.0, 0.2, random),
        "dividend_yield": curve(row, 0.0, 0.2, random),
        "volatility": curve(row, 0.05, 1.0, random),
    }
    return paying({**row, **given}, spread_out(row, 2, random), random)


def negative_yield(random: np.random.Generator) -> Row:
    """Return a contract with a negative yield and four cash dividends."""
    row = {**flat(random), "dividend_yield": -random.uniform(0.005, 0.05)}
    return paying(row, spread_out(row, 4, random), random)


def paying_weekly(row: Row, count: int, random: np.random.Generator, kind: DividendKind = "cash") -> Row:
    """Return the contract with so many small dividends, one each week, and its expiry half a week after the last."""
    row = {**row, "expiry": (count + 0.5) * WEEK}
    return paying(row, every(row, WEEK, random)[:count], random, kind, size=(2e-4, 1e-3))


def weekly(random: np.random.Generator) -> Row:
    """Return a contract with sixty small cash dividends."""
    return paying_weekly(flat(random), 60, random)


def long_dated(random: np.random.Generator) -> Row:
    """Return a contract of ten to forty years with a cash dividend each year."""
    row = {**flat(random), "expiry": random.uniform(10.0, 40.0)}
    return paying(row, every(row, 1.0, random), random)
