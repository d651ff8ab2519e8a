"""What the engine benchmark measured, and its report."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from benchmarks.option_engine import throughput
from benchmarks.option_engine.march_scaling import MarchCost
from benchmarks.option_engine.portfolio_study import PortfolioStudy
from benchmarks.option_engine.wide_set import ToleranceKept
from benchmarks.option_engine.work_precision import ERRORS, points
from benchmarks.quantlib.american_engines import CallOverhead
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table
from benchmarks.reporting.scaling import exponent

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
    rates: Mapping[str, throughput.Rate]
    sharing_difference: float | None
    latency: float
    march: tuple[MarchCost, ...]


def compose(found: Findings, *, quick: bool = False) -> Report:
    """Return the report; a quick one says that its figures mean little."""
    rates = [rate._asdict() | {"options per second": rate.per_second} for rate in found.rates.values()]
    return Report(
        "engine-frontier",
        "Accuracy against time: this engine and QuantLib",
        "How fast is this engine for a given accuracy, beside QuantLib on the same contracts?",
        (
            Section("What was found", "\n\n".join([QUICK_RUN] * quick + list(sentences(found)))),
            *(_study_section(study, found.overhead) for study in found.studies),
            *(
                [Section("Is the tolerance kept?", KEPT, (table("wide-set", found.kept),))]
                if found.kept
                else []
            ),
            Section("Batches, threads, Greeks", BATCHES, (table("throughput", rates),)),
            Section("What limits: time steps", MARCH, (table("march", found.march),)),
            Section("How it was measured", METHOD),
        ),
        {
            "sharing_difference": found.sharing_difference,
            "latency_microseconds": found.latency,
            "quantlib_call_microseconds": None if found.overhead is None else found.overhead._asdict(),
        },
    )


def sentences(found: Findings) -> Iterator[str]:
    """Give one sentence for each finding."""
    if found.overhead is None:
        yield f"{NO_PEER}."
    for study in found.studies:
        times = [
            f"{one.ratio:.3g} times {one.peer} at {one.rmse:.0e}"
            for one in study.ratios
            if one.ratio is not None
        ]
        if times:
            yield f"{study.title}: the engine is as fast as {', '.join(times)} of the strike, root mean square."
    for kept in found.kept:
        yield f"""At the tolerance {kept.tolerance:.0e} {kept.within:.2%} of the wide set are within it, the largest
            error of an ok row is {kept.largest_ok:.2g} tolerances, {kept.honest:.1%} of the estimates are at least
            half the error, and the median estimate is {kept.overestimate:.2g} times the error."""
    time = {name: rate.microseconds for name, rate in found.rates.items()}
    threads = time[throughput.PRICE_ONLY] / time[throughput.TWO_THREADS]
    greeks = time[throughput.ALL_GREEKS] / time[throughput.PRICE_ONLY]
    yield f"""Two threads are {threads:.2f} times as fast as one; all Greeks cost {greeks:.2f} times the price alone;
        one warm `price()` with all Greeks takes {found.latency:.0f} microseconds."""
    if found.sharing_difference is not None:
        yield f"""Ladders and chains share solves; their prices differ from those without sharing by at most
            {found.sharing_difference:.1e} of the strike."""
    power = exponent([(one.steps, one.microseconds) for one in found.march], 3)
    yield f"The time of a march grows with the time steps to the power of {power:.2f}."


def _study_section(study: PortfolioStudy, overhead: CallOverhead | None) -> Section:
    slug = study.title.lower().replace(" ", "-")
    reference = (
        "this engine itself at its least tolerance"
        if overhead is None
        else "QuantLib's QdFp at high precision"
    )
    text = f"""{study.contracts} contracts, priced by every method unless the table says fewer. Errors are fractions
        of the strike, against {reference}; {study.left_out} rows where its two fixed-point systems disagree by more
        than 1e-8 are left out. The strict ratio takes a whole European valuation off the peer's time."""
    panels = {
        title: {
            name: [(point.microseconds, point.error) for point in points(study.measurements, name, error)]
            for name in dict.fromkeys(one.family for one in study.measurements)
        }
        for error, title in ERRORS
    }
    figure = curves(
        panels, "microseconds per option", "error, fraction of the strike", study.title, envelope=0.0
    )
    ratios = [table(f"{slug}-ratios", study.ratios)] if study.ratios else []
    return Section(study.title, text, (table(slug, study.measurements), *ratios), {slug: figure})


KEPT = """Random contracts with S/K 0.4-2.5, 5 days to 10 years, volatility 3-150 %, rate and yield 0-15 %, without
rows where the reference's two systems disagree by more than 1e-8 of the strike. Largest ok is in tolerances, honest
the share of estimates of at least half the error."""
BATCHES = f"`price_many` at tolerance {throughput.TOLERANCE:g} unless a row says otherwise, random everyday contracts."
MARCH = """Random puts of up to two years, marched with a given number of steps, half and a quarter of them, and
extrapolated. Nanoseconds and cycles (at the nominal clock) are those of one step, RMSE is against this engine's
finest mesh."""
METHOD = """Every time is the least of six or more, methods in turn, one thread. This engine prices all rows by one
call of `price_many`, price only; slow methods price a fixed random choice. Ratios compare the lower envelopes of RMSE
and time.

QuantLib's instruments and engines are built beforehand, and a call from Python that calculates nothing is taken off its
times. QdFp's Legendre schemes are the best of about a thousand. Expiries are whole days over 360 for both sides."""
