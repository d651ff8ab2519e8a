"""The findings of the engine benchmark in words, tables and figures."""

from typing import Any

from benchmarks.option_engine.findings import Findings, goals_of
from benchmarks.option_engine.frontier_figure import frontier_figure
from benchmarks.option_engine.goals import Goal
from benchmarks.option_engine.portfolio_study import PortfolioStudy
from benchmarks.option_engine.throughput import TOLERANCE
from benchmarks.option_engine.wide_set import ToleranceKept
from benchmarks.quantlib.american_engines import CallOverhead
from benchmarks.reporting.report import Report, Section, Table

QUICK_RUN = (
    "A quick run: with so few contracts the figures mean little, and times per option are far too long."
)
NO_PEER = "QuantLib is not installed (extra [bench]), so the peers are missing"
MEASUREMENT_COLUMNS = (
    "method",
    "setting",
    "microseconds per option",
    "RMSE",
    "largest error",
    "contracts",
    "without price",
)
RATIO_COLUMNS = (
    "peer",
    "RMSE",
    "this engine, microseconds",
    "peer, microseconds",
    "ratio",
    "ratio, a European value taken off the peer's time",
)
MARCH_COLUMNS = (
    "time steps",
    "microseconds per option",
    "with derivatives",
    "RMSE",
    "nanoseconds per step",
    "cycles per step",
)
KEPT_COLUMNS = (
    "tolerance",
    "rows",
    "left out",
    "share within tolerance",
    "share ok",
    "ok rows within 5 tolerances",
    "largest ok error / tolerance",
    "estimate >= error / 2",
    "median estimate / error",
    "microseconds per option",
)


def compose(findings: Findings, *, quick: bool = False) -> Report:
    """Return the report; a quick one says that its figures mean little."""
    goals = goals_of(findings)
    sections = [_summary(findings, goals, quick=quick)]
    sections += [_study_section(study, findings.overhead) for study in findings.studies]
    if findings.kept:
        sections.append(_kept_section(findings.kept))
    sections += [_throughput_section(findings), _march_section(findings), _method_section(findings.overhead)]
    return Report(
        name="engine-frontier",
        title="Accuracy against time: this engine and QuantLib",
        question="How fast is this engine for a given accuracy, beside QuantLib on the same contracts?",
        sections=tuple(sections),
        results=_results(findings, goals),
    )


def _summary(findings: Findings, goals: tuple[Goal, ...], *, quick: bool) -> Section:
    met = sum(goal.verdict() == "reached" for goal in goals)
    measured = sum(goal.verdict() != "not measured" for goal in goals)
    sentences = [QUICK_RUN] if quick else []
    sentences.append(f"{met} of {measured} measured goals are reached.")
    sentences += [
        f"{goal.what}: {goal.reached:.3g}, the goal is {goal.goal:g}: {goal.verdict()}."
        for goal in goals
        if goal.verdict().startswith("missed") and goal.reached is not None
    ]
    unmeasured = [goal.what for goal in goals if goal.verdict() == "not measured"]
    if unmeasured:
        sentences.append(f"Not measured: {'; '.join(unmeasured)}.")
    if findings.overhead is None:
        sentences.append(f"{NO_PEER}.")
    rows = tuple(
        (goal.what, goal.sense, goal.goal, goal.least, goal.reached, goal.verdict()) for goal in goals
    )
    columns = ("what", "sense", "goal", "least", "reached", "verdict")
    return Section("Goals and what is reached", "\n\n".join(sentences), (Table(columns, rows, "goals"),))


def _study_section(study: PortfolioStudy, overhead: CallOverhead | None) -> Section:
    slug = study.title.lower().replace(" ", "-")
    text = f"{study.contracts} contracts, priced by every method unless the table says fewer. "
    if overhead is None:
        text += f"{NO_PEER}; errors are measured against this engine itself at its least tolerance."
    else:
        text += (
            "Errors are measured against QuantLib's QdFp at high precision; "
            f"{study.left_out} rows where its two fixed-point systems disagree by more than 1e-8 of the strike are "
            "left out. For an error that even the fastest setting undercuts, the ratios take that setting's time."
        )
    tables = [Table(MEASUREMENT_COLUMNS, study.measurements, slug)]
    if study.ratios:
        tables.append(Table(RATIO_COLUMNS, study.ratios, f"{slug}-ratios"))
    figure = frontier_figure(study.measurements, f"{study.title}: error against time")
    return Section(study.title, text, tuple(tables), ((slug, figure),))


def _kept_section(kept: tuple[ToleranceKept, ...]) -> Section:
    text = (
        "Random contracts with S/K 0.4-2.5, 5 days to 10 years, volatility 3-150 %, rate and yield 0-15 %. An error "
        "is the distance to the reference, less the disagreement of the reference's two systems; rows where that "
        f"exceeds 1e-8 of the strike are left out: {kept[0].left_out}."
    )
    return Section("Is the tolerance kept?", text, (Table(KEPT_COLUMNS, kept, "wide-set"),))


def _throughput_section(findings: Findings) -> Section:
    rows = tuple(
        (rate.what, rate.rows, rate.microseconds, rate.per_second) for rate in findings.rates.values()
    )
    text = f"`price_many` at tolerance {TOLERANCE:g}, random everyday contracts. "
    if findings.sharing_difference is None:
        text += "Shared solves are not offered by this version, so ladders and chains are not measured. "
    else:
        text += (
            "Ladders and chains share solves; their prices differ from those without sharing by at most "
            f"{findings.sharing_difference:.1e} of the strike. "
        )
    text += f"One warm `price()` with all Greeks takes {findings.latency:.0f} microseconds."
    columns = ("batch", "rows per call", "microseconds per option", "options per second")
    return Section("Batches, threads, Greeks, latency", text, (Table(columns, rows, "throughput"),))


def _march_section(findings: Findings) -> Section:
    text = (
        "Random puts of up to two years, marched with a given number of time steps, half and a quarter of them, and "
        "extrapolated; nothing is refined. Each step solves three tridiagonal complementarity problems, on a grid "
        "that has the more nodes the more steps there are; the time of a step is an average over the three marches. "
        "Cycles are at the processor's nominal clock. With derivatives: by rate, yield and volatility, in the two "
        "finer marches. RMSE is against this engine's finest mesh."
    )
    return Section("What limits: time steps", text, (Table(MARCH_COLUMNS, findings.march, "march"),))


def _method_section(overhead: CallOverhead | None) -> Section:
    text = (
        "Every time is the least of six or more: the methods take turns, so that other work on the machine meets "
        "them all, and in each turn make every call twice in a row, so that one finds its data in the cache. "
        "This engine prices all rows by one call of `price_many` on one thread, price only, the cost of that call "
        "included. The LCS path, Crank-Nicolson, finite differences, trees and QdFp's high-precision scheme "
        "take milliseconds per option and are measured on a fixed random choice of the contracts. Ratios compare the "
        "lower envelopes of RMSE and time, by straight lines in logarithms."
    )
    if overhead is not None:
        text += (
            "\n\nQuantLib runs one thread too, with instruments, processes and engines built beforehand: only "
            "`recalculate()` is timed, in portions of 64 contracts whose least times are added. A call from Python "
            f"that calculates nothing takes {overhead.empty:.2f} microseconds and is taken off every QuantLib time, so "
            "that what remains is what a user of the C++ library sees. A European option by the analytic engine "
            f"takes {overhead.european:.2f} microseconds; the last column of the ratios takes all of it off QuantLib's "
            "time, which favours QuantLib. QdFp's Legendre schemes are the best of a sweep of about a thousand. "
            "Expiries are whole days over 360, so that both sides see the same numbers."
        )
    return Section("How it was measured", text)


def _results(findings: Findings, goals: tuple[Goal, ...]) -> dict[str, Any]:
    return {
        "goals": [goal._asdict() | {"verdict": goal.verdict()} for goal in goals],
        "portfolios": [
            {
                "title": study.title,
                "contracts": study.contracts,
                "left_out": study.left_out,
                "measurements": [one._asdict() for one in study.measurements],
                "ratios": [ratio._asdict() for ratio in study.ratios],
            }
            for study in findings.studies
        ],
        "wide_set": [kept._asdict() for kept in findings.kept],
        "rates": [rate._asdict() for rate in findings.rates.values()],
        "sharing_difference": findings.sharing_difference,
        "latency_microseconds": findings.latency,
        "march": [cost._asdict() for cost in findings.march],
        "quantlib_call_microseconds": None if findings.overhead is None else findings.overhead._asdict(),
    }
