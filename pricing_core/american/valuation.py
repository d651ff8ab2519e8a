"""Price one option in a flat market: value, Greeks, exercise boundary and an honest error estimate."""

import math
from dataclasses import replace

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.engine import (
    Estimate,
    coarsest_resolution,
    estimate_at_resolution,
    estimate_to_tolerance,
    make_solver,
    region_near_strike,
)
from pricing_core.american.flat.exercise_region import EMPTY_REGION, ExerciseRegion, region_at_expiry
from pricing_core.american.flat.limits import (
    ClosedValue,
    deterministic_error,
    deterministic_value,
    european_value,
    expired_value,
    holding_theta,
    is_closed_form,
    is_deterministic,
)
from pricing_core.american.flat.resolution import Resolution
from pricing_core.american.results import Diagnostics, Status, Valuation, assemble, without_price
from pricing_core.american.solver_settings import SolverSettings
from pricing_core.american.tables.book import single_row
from pricing_core.american.tables.book_values import MARCHED, value_book

MARCH_METHOD = "premium-march"


def price_alone(option: Option, market: FlatMarket, settings: SolverSettings) -> Valuation:
    """Price one option without the march: by a formula or on the general path."""
    tolerance, interrupt = settings.tolerance, settings.interrupt
    if option.expiry == 0.0 or is_closed_form(option, market):
        solved_by = "expired" if option.expiry == 0.0 else "closed form"
        return _from_closed(option, market, european_value(option, market), solved_by, tolerance)
    deterministic = replace(deterministic_value(option, market), error=deterministic_error(option, market))
    at_strike = replace(market, spot=max(market.spot, option.strike))  # a spot of 0 has no chance to show
    if is_deterministic(option, at_strike, tolerance):
        return _from_closed(option, market, deterministic, "zero volatility", tolerance)
    first = _first_resolution(option, market, settings)
    if market.spot == 0.0:
        region = region_near_strike(option, market, tolerance, first.refined().refined(), interrupt)
        return _from_closed(option, market, deterministic, "worthless underlying", tolerance, region)
    greeks, lcp_method = settings.greeks is not False, settings.lcp_method
    solver = make_solver(
        option, market, tolerance, first, lcp_method=lcp_method, tangents=greeks, interrupt=interrupt
    )
    if settings.resolution is None:
        estimate = estimate_to_tolerance(solver, tolerance, first)
    else:
        estimate = estimate_at_resolution(solver, first)
    if estimate is None:
        return without_price(option, market.spot, european_value(option, market).value)
    if deterministic.error <= estimate.error * option.strike:
        return _from_closed(option, market, deterministic, "zero volatility", tolerance)
    if estimate.region.is_open_at_strike(option):
        near = region_near_strike(option, market, tolerance, estimate.solution.resolution, interrupt)
        estimate = replace(estimate, region=estimate.region.completed_by(near))
    return _from_estimate(option, market, estimate, tolerance, lcp_method, greeks)


def _first_resolution(option: Option, market: FlatMarket, settings: SolverSettings) -> Resolution:
    """Return the resolution to begin with, its scheme settled."""
    if settings.resolution is None:
        return coarsest_resolution(option, market, settings.scheme)
    return replace(settings.resolution, scheme=settings.scheme)


def _from_estimate(
    option: Option, market: FlatMarket, estimate: Estimate, tolerance: float, lcp_method: str, greeks: bool
) -> Valuation:
    resolution = estimate.solution.resolution
    states = estimate.solution.integration.states
    error = option.strike * estimate.error
    if estimate.exercised:
        closed = replace(expired_value(option, market), error=error)
    else:
        closed = _not_below(
            max(option.payoff(market.spot), european_value(option, market).value),
            _held(option, market, estimate, error),
        )
    if not greeks or resolution.formulation == "value":
        closed = replace(closed, vega=math.nan, rho=math.nan, dividend_rho=math.nan)
    diagnostics = Diagnostics(
        solved_by="method of lines",
        resolution=resolution,
        solves=estimate.solves,
        steps_taken=estimate.solution.integration.accepted,
        lcp_method=lcp_method,
        lcp_residual=max(state.residual for state in states),
        fitted=estimate.solution.form.operators.fitted,
    )
    status: Status = "ok" if closed.error <= tolerance * option.strike else "tolerance_not_met"
    return assemble(
        option,
        market.spot,
        closed,
        european=european_value(option, market).value,
        boundary=estimate.region.boundaries(option)[0],
        exercise_now=estimate.exercised and option.payoff(market.spot) > 0.0,
        status="deadline" if estimate.interrupted else status,
        method=resolution.scheme or "",
        diagnostics=diagnostics,
    )


def _not_below(bound: float, closed: ClosedValue) -> ClosedValue:
    """Lift the value to what it cannot be less than; what was missing counts as error."""
    missing = bound - closed.value
    return closed if missing <= 0.0 else replace(closed, value=bound, error=max(closed.error, missing))


def _held(option: Option, market: FlatMarket, estimate: Estimate, error: float) -> ClosedValue:
    """Return value and derivatives in money where the option is not exercised now."""
    K, S = option.strike, market.spot
    (value, slope, second), *tangents = estimate.values.tolist()
    vega, rho, dividend_rho = (K * row[0] for row in tangents) if tangents else [math.nan] * 3
    return ClosedValue(
        value=K * value,
        delta=K / S * slope,
        gamma=K / S * ((second - slope) / S),
        theta=K * holding_theta(market, value, slope, second - slope),
        vega=vega,
        rho=rho,
        dividend_rho=dividend_rho,
        error=error,
    )


def march_value(option: Option, market: FlatMarket, tolerance: float, greeks: bool) -> Valuation | None:
    """Return the march's valuation; None where the march does not serve the option."""
    if option.exercise == "european":
        return None
    values = value_book(single_row(option, market, tolerance), greeks=greeks, threads=1, shared=False)
    if values.path[0] != MARCHED:
        return None
    error = values.error.item()
    return values.valuation(
        option,
        market.spot,
        status="ok" if error <= tolerance * option.strike else "tolerance_not_met",
        method=MARCH_METHOD,
        diagnostics=Diagnostics("premium march", steps_taken=values.steps.item()),
    )


def _from_closed(
    option: Option,
    market: FlatMarket,
    closed: ClosedValue,
    solved_by: str,
    tolerance: float,
    region: ExerciseRegion | None = None,
) -> Valuation:
    intrinsic = option.payoff(market.spot)
    if option.expiry == 0.0:
        region = ExerciseRegion(-math.inf, 0.0) if option.is_put else ExerciseRegion(0.0, math.inf)
        exercise_now = intrinsic > 0.0
    else:
        exercise_now = not is_closed_form(option, market) and intrinsic > 0.0 and closed.value == intrinsic
    if region is None:
        region = region_at_expiry(option, market) if option.exercise == "american" else EMPTY_REGION
    return assemble(
        option,
        market.spot,
        closed,
        european=european_value(option, market).value,
        boundary=region.boundaries(option)[0],
        exercise_now=exercise_now,
        status="ok" if closed.error <= tolerance * option.strike else "tolerance_not_met",
        method=solved_by.replace(" ", "-"),
        diagnostics=Diagnostics(solved_by),
    )
