"""What the engine benchmark measured, the goals that it is held against, and its report."""

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.option_engine.goals import Goal
from benchmarks.option_engine.march_scaling import MarchCost
from benchmarks.option_engine.portfolio_study import PortfolioStudy
from benchmarks.option_engine.throughput import (
    ALL_GREEKS,
    CHAINS,
    GREEKS_BY_DEFAULT,
    LADDERS,
    PRICE_BY_DEFAULT,
    PRICE_ONLY,
    TOLERANCE,
    TWO_THREADS,
    Rate,
)
from benchmarks.option_engine.wide_set import ToleranceKept
from benchmarks.option_engine.work_precision import ERRORS, points
from benchmarks.quantlib.american_engines import FINITE_DIFFERENCES, CallOverhead
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table

QUICK_RUN = (
    "A quick run: with so few contracts the figures mean little, and times per option are far too long."
)
NO_PEER = "QuantLib is not installed (extra [bench]), so the peers are missing"


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
    goals = [
        Goal(
            f"{study.title}: times as fast as {ratio.peer} at RMSE {ratio.rmse:.0e}",
            ">=",
            *((1000.0, ratio.ratio) if ratio.peer == FINITE_DIFFERENCES else (10.0, ratio.ratio, 5.0)),
        )
        for study in findings.studies
        for ratio in study.ratios
    ]
    rates, time = findings.rates, {name: rate.microseconds for name, rate in findings.rates.items()}
    for what, wanted in ((LADDERS, 2e6), (CHAINS, 1e6)):
        reached = rates[what].per_second if what in rates else None
        goals.append(Goal(f"{what}, options per second and core", ">=", wanted, reached))
    goals += [
        Goal("two threads against one, times as fast", ">=", 1.7, time[PRICE_ONLY] / time[TWO_THREADS]),
        Goal(
            "all Greeks against the price alone, times the cost",
            "<=",
            3.5,
            time[ALL_GREEKS] / time[PRICE_ONLY],
        ),
        Goal(
            "the same at the default tolerance", "<=", 3.5, time[GREEKS_BY_DEFAULT] / time[PRICE_BY_DEFAULT]
        ),
        Goal("one warm price() with all Greeks, microseconds", "<=", 300.0, findings.latency),
    ]
    for kept in findings.kept:
        at = f"wide set at tolerance {kept.tolerance:.0e}:"
        goals += [
            Goal(f"{at} share of rows within it", ">=", 0.99, kept.within),
            Goal(f"{at} largest error of an ok row, in tolerances", "<=", 5.0, kept.largest_ok),
            Goal(f"{at} share of estimates of at least half the error", ">=", 0.98, kept.honest),
            Goal(f"{at} median of estimate / error", "<=", 30.0, kept.overestimate),
        ]
    return tuple(goals)


def compose(findings: Findings, *, quick: bool = False) -> Report:
    """Return the report; a quick one says that its figures mean little."""
    kept = [_kept_section(findings.kept)] if findings.kept else []
    return Report(
        "engine-frontier",
        "Accuracy against time: this engine and QuantLib",
        "How fast is this engine for a given accuracy, beside QuantLib on the same contracts?",
        (
            _summary(findings, goals_of(findings), quick=quick),
            *(_study_section(study, findings.overhead) for study in findings.studies),
            *kept,
            _throughput_section(findings),
            Section("What limits: time steps", MARCH, (table("march", findings.march),)),
            Section("How it was measured", METHOD + ("" if findings.overhead is None else QUANTLIB)),
        ),
        {
            "sharing_difference": findings.sharing_difference,
            "latency_microseconds": findings.latency,
            "quantlib_call_microseconds": None if findings.overhead is None else findings.overhead._asdict(),
        },
    )


def _summary(findings: Findings, goals: tuple[Goal, ...], *, quick: bool) -> Section:
    verdicts = [goal.verdict() for goal in goals]
    sentences = [QUICK_RUN] if quick else []
    measured = len(goals) - verdicts.count("not measured")
    sentences.append(f"{verdicts.count('reached')} of {measured} measured goals are reached.")
    sentences += [
        f"{goal.what}: {goal.reached:.3g}, the goal is {goal.goal:g}: {verdict}."
        for goal, verdict in zip(goals, verdicts, strict=True)
        if verdict.startswith("missed")
    ]
    if unmeasured := [one.what for one, word in zip(goals, verdicts, strict=True) if word == "not measured"]:
        sentences.append(f"Not measured: {'; '.join(unmeasured)}.")
    if findings.overhead is None:
        sentences.append(f"{NO_PEER}.")
    rows = [goal._asdict() | {"verdict": verdict} for goal, verdict in zip(goals, verdicts, strict=True)]
    return Section("Goals and what is reached", "\n\n".join(sentences), (table("goals", rows),))


def _study_section(study: PortfolioStudy, overhead: CallOverhead | None) -> Section:
    slug = study.title.lower().replace(" ", "-")
    text = f"{study.contracts} contracts, priced by every method unless the table says fewer. "
    if overhead is None:
        text += f"{NO_PEER}; errors are measured against this engine itself at its least tolerance."
    else:
        text += f"""Errors are fractions of the strike, against QuantLib's QdFp at high precision; {study.left_out} rows
            where its two fixed-point systems disagree by more than 1e-8 of the strike are left out. For an error that
            even the fastest setting undercuts, the ratios take that setting's time; the strict ratio takes a whole
            European valuation off the peer's time."""
    families = dict.fromkeys(one.family for one in study.measurements)
    panels = {
        title: {
            name: [(point.microseconds, point.error) for point in points(study.measurements, name, error)]
            for name in families
        }
        for error, title in ERRORS
    }
    figure = curves(
        panels, "microseconds per option", "error, fraction of the strike", study.title, envelope=0.0
    )
    ratios = [table(f"{slug}-ratios", study.ratios)] if study.ratios else []
    return Section(study.title, text, (table(slug, study.measurements), *ratios), {slug: figure})


def _kept_section(kept: tuple[ToleranceKept, ...]) -> Section:
    text = f"""Random contracts with S/K 0.4-2.5, 5 days to 10 years, volatility 3-150 %, rate and yield 0-15 %. An
        error is the distance to the reference, less the disagreement of the reference's two systems; rows where that
        exceeds 1e-8 of the strike are left out: {kept[0].left_out}. Largest ok is in tolerances; honest is the share of
        estimates of at least half the error; overestimate is the median of estimate / error."""
    return Section("Is the tolerance kept?", text, (table("wide-set", kept),))


def _throughput_section(findings: Findings) -> Section:
    text = f"`price_many` at tolerance {TOLERANCE:g}, random everyday contracts. "
    if findings.sharing_difference is None:
        text += "Shared solves are not offered by this version, so ladders and chains are not measured. "
    else:
        text += f"""Ladders and chains share solves; their prices differ from those without sharing by at most
            {findings.sharing_difference:.1e} of the strike. """
    text += f"One warm `price()` with all Greeks takes {findings.latency:.0f} microseconds."
    rows = [rate._asdict() | {"options per second": rate.per_second} for rate in findings.rates.values()]
    return Section("Batches, threads, Greeks, latency", text, (table("throughput", rows),))


MARCH = """Random puts of up to two years, marched with a given number of time steps, half and a quarter of them, and
extrapolated; nothing is refined. Each step solves three tridiagonal complementarity problems, on a grid with the more
nodes the more steps there are; nanoseconds and cycles (at the nominal clock) are those of one step, RMSE is against
this engine's finest mesh."""
METHOD = """Every time is the least of six or more; the methods take turns, so that other work on the machine meets them
all. This engine prices all rows by one call of `price_many` on one thread, price only. The LCS path, Crank-Nicolson,
finite differences, trees and QdFp's high-precision scheme are measured on a fixed random choice of the contracts.
Ratios compare the lower envelopes of RMSE and time, by straight lines in logarithms."""
QUANTLIB = """

QuantLib runs one thread too, with instruments, processes and engines built beforehand; a call from Python that
calculates nothing is taken off every QuantLib time, so that what remains is what a user of the C++ library sees. QdFp's
Legendre schemes are the best of a sweep of about a thousand. Expiries are whole days over 360 for both sides."""
