"""What the engine benchmark found, and the goals that it is held against."""

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.option_engine.goals import Goal
from benchmarks.option_engine.march_scaling import MarchCost
from benchmarks.option_engine.portfolio_study import PortfolioStudy, Ratio
from benchmarks.option_engine.throughput import (
    ALL_GREEKS,
    CHAINS,
    GREEKS_BY_DEFAULT,
    LADDERS,
    PRICE_BY_DEFAULT,
    PRICE_ONLY,
    TWO_THREADS,
    Rate,
)
from benchmarks.option_engine.wide_set import ToleranceKept
from benchmarks.quantlib.american_engines import FINITE_DIFFERENCES, CallOverhead


@dataclass(frozen=True, slots=True)
class Findings:
    """What was measured; `overhead` is None without QuantLib, `sharing_difference` without shared solves."""

    overhead: CallOverhead | None
    studies: tuple[PortfolioStudy, ...]
    kept: tuple[ToleranceKept, ...]
    rates: Mapping[str, Rate]
    sharing_difference: float | None
    latency: float
    march: tuple[MarchCost, ...]


def goals_of(findings: Findings) -> tuple[Goal, ...]:
    """Return every goal with the figure reached."""
    rates = findings.rates
    goals = [_ratio_goal(study, ratio) for study in findings.studies for ratio in study.ratios]
    for what, wanted in ((LADDERS, 2e6), (CHAINS, 1e6)):
        reached = rates[what].per_second if what in rates else None
        goals.append(Goal(f"{what}, options per second and core", ">=", wanted, reached))
    one, two, greeks = (rates[what].microseconds for what in (PRICE_ONLY, TWO_THREADS, ALL_GREEKS))
    goals.append(Goal("two threads against one, times as fast", ">=", 1.7, one / two))
    goals.append(Goal("all Greeks against the price alone, times the cost", "<=", 3.5, greeks / one))
    price, greeks = (rates[what].microseconds for what in (PRICE_BY_DEFAULT, GREEKS_BY_DEFAULT))
    goals.append(Goal("the same at the default tolerance", "<=", 3.5, greeks / price))
    goals.append(Goal("one warm price() with all Greeks, microseconds", "<=", 300.0, findings.latency))
    for kept in findings.kept:
        goals += _kept_goals(kept)
    return tuple(goals)


def _ratio_goal(study: PortfolioStudy, ratio: Ratio) -> Goal:
    goal, least = (1000.0, None) if ratio.peer == FINITE_DIFFERENCES else (10.0, 5.0)
    what = f"{study.title}: times as fast as {ratio.peer} at RMSE {ratio.rmse:.0e}"
    return Goal(what, ">=", goal, ratio.ratio, least)


def _kept_goals(kept: ToleranceKept) -> tuple[Goal, ...]:
    at = f"wide set at tolerance {kept.tolerance:.0e}:"
    return (
        Goal(f"{at} share of rows within it", ">=", 0.99, kept.within),
        Goal(f"{at} largest error of an ok row, in tolerances", "<=", 5.0, kept.largest_ok),
        Goal(f"{at} share of estimates of at least half the error", ">=", 0.98, kept.honest),
        Goal(f"{at} median of estimate / error", "<=", 30.0, kept.overestimate),
    )
