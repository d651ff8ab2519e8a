"""How fast is this engine for a given accuracy, beside QuantLib on the same contracts in the same run?"""

from dataclasses import dataclass

from benchmarks.measuring.machine import nominal_megahertz
from benchmarks.option_engine.march_scaling import march_costs
from benchmarks.option_engine.portfolio_study import Effort, study_portfolio
from benchmarks.option_engine.report import Findings, compose
from benchmarks.option_engine.throughput import (
    CAN_SHARE,
    batch_rates,
    latency,
    shared_rates,
    sharing_difference,
)
from benchmarks.option_engine.wide_set import TOLERANCES, ToleranceKept, tolerance_kept
from benchmarks.problems.portfolios import (
    andersen_lake_offengenden,
    everyday,
    option_chains,
    spot_ladders,
    wide,
)
from benchmarks.quantlib import american_engines
from benchmarks.reporting.report import Report
from pricing_core.american.engines.chunks import LARGEST_CHUNK

# Lowest price that counts, as a fraction of the strike, as with Andersen, Lake and Offengenden.
LEAST_PRICE = 0.005
OVERHEAD_ROWS = 1000


@dataclass(frozen=True, slots=True)
class Sizes:
    """How many contracts each part takes."""

    published: int
    everyday: int
    wide: int
    batch: int
    ladders: int
    chains: int
    marched: int
    effort: Effort


FULL = Sizes(
    published=6000,
    everyday=LARGEST_CHUNK,
    wide=2000,
    batch=32768,
    ladders=64,
    chains=16,
    marched=2048,
    effort=Effort(
        tolerances=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8),
        single_rows=16,
        single_tolerances=(1e-3, 1e-4, 1e-5, 1e-6),
        screened_rows=160,
        slow_rows=120,
    ),
)
QUICK = Sizes(
    published=100,
    everyday=64,
    wide=64,
    batch=512,
    ladders=8,
    chains=1,
    marched=64,
    effort=Effort(
        tolerances=(1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
        single_rows=3,
        single_tolerances=(1e-3, 1e-4),
        screened_rows=12,
        slow_rows=12,
    ),
)


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes fewer contracts."""
    return compose(findings(QUICK if quick else FULL), quick=quick)


def findings(sizes: Sizes) -> Findings:
    """Measure everything on as many contracts as the sizes say."""
    published = andersen_lake_offengenden()
    overhead = None
    if american_engines.AVAILABLE:
        overhead = american_engines.call_overhead(everyday(OVERHEAD_ROWS))
    studies = (
        study_portfolio(
            "Andersen-Lake-Offengenden puts",
            published.take(published.sample(sizes.published)),
            sizes.effort,
            overhead,
            LEAST_PRICE,
        ),
        study_portfolio("Random puts and calls", everyday(sizes.everyday), sizes.effort, overhead),
    )
    rates, sharing = batch_rates(sizes.batch), None
    if CAN_SHARE:
        rates |= shared_rates(sizes.ladders, sizes.chains)
        sharing = max(sharing_difference(spot_ladders(2)), sharing_difference(option_chains(1)))
    kept: tuple[ToleranceKept, ...] = ()
    if american_engines.AVAILABLE:
        contracts = wide(sizes.wide)
        reference = american_engines.reference_prices(contracts)
        kept = tuple(tolerance_kept(contracts, reference, tolerance) for tolerance in TOLERANCES)
    march = march_costs(sizes.marched, nominal_megahertz())
    return Findings(overhead, studies, kept, rates, sharing, latency(), march)
