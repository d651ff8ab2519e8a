"""Price one option: value, Greeks, exercise boundary and an honest error estimate."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

from pricing_core.american.contract import Option, real_number
from pricing_core.american.engine import (
    Estimate,
    coarsest_resolution,
    estimate_at_resolution,
    estimate_to_tolerance,
    make_solver,
    region_near_strike,
)
from pricing_core.american.exercise_region import EMPTY_REGION, ExerciseRegion, region_at_expiry
from pricing_core.american.limits import (
    ClosedValue,
    deterministic_error,
    deterministic_value,
    european_value,
    expired_value,
    holding_theta,
    is_closed_form,
    is_deterministic,
)
from pricing_core.american.market import Market
from pricing_core.american.resolution import Resolution, Scheme
from pricing_core.american.results import Diagnostics, Status, Valuation, assemble, without_price
from pricing_core.american.tridiagonal_step import LCPMethod
from pricing_core.errors import InvalidInputError

Method: TypeAlias = Literal["auto", "lcs", "crank-nicolson"]
SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-8, 1e-2  # fractions of the strike
DEFAULT_TOLERANCE = 1e-6
LARGEST_RATIO = 1e30  # of spot and strike, either way


def price(
    option: Option,
    market: Market,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    method: Method = "auto",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: bool = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price an option to a tolerance.

    American options are solved by the method of lines as a linear complementarity system, (11.59)-(11.65) of
    Schumacher's chapter on complementarity systems, for
    the early exercise premium, at two or more resolutions, and extrapolated; European ones, and those never
    exercised early, by the closed formula.

    Parameters
    ----------
    option : Option
    market : Market
    tolerance : float
        Absolute error of the price as a fraction of the strike, 1e-8 to 1e-2.
    method : {"auto", "lcs", "crank-nicolson"}
        "auto" is "lcs", stepped by SDIRK2; "crank-nicolson" is stepped by Crank and Nicolson's method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each step's complementarity problem.
    greeks : bool
        False leaves out vega, rho and dividend rho, which cost about as much again as the price.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps, once, without extrapolation; the error is estimated from a
        second solve with half as many of each.
    interrupt : callable, optional
        Asked before every time step; True ends the work with status "deadline".

    Returns
    -------
    Valuation
        With status "tolerance_not_met" where the estimated error exceeds the tolerance at the finest
        resolution.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.

    Examples
    --------
    >>> valuation = price(Option("put", strike=100.0, expiry=1.0), Market(100.0, rate=0.05, volatility=0.2))
    >>> round(valuation.price, 3), round(valuation.exercise_boundary, 1), valuation.status
    (6.09, 80.9, 'ok')
    """
    tolerance = real_number("tolerance", tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
    _check_choice("method", method, ("auto", "lcs", "crank-nicolson"))
    _check_choice("lcp_method", lcp_method, ("tridiagonal", "policy", "psor", "lemke"))
    check_moneyness(option, market)
    if option.expiry == 0.0 or is_closed_form(option, market):
        solved_by = "expired" if option.expiry == 0.0 else "closed form"
        return _from_closed(option, market, european_value(option, market), solved_by, tolerance)
    deterministic = replace(deterministic_value(option, market), error=deterministic_error(option, market))
    at_strike = replace(market, spot=max(market.spot, option.strike))  # a spot of 0 has no chance to show
    if is_deterministic(option, at_strike, tolerance):
        return _from_closed(option, market, deterministic, "zero volatility", tolerance)
    first = _first_resolution(option, market, method, resolution)
    if market.spot == 0.0:
        region = region_near_strike(option, market, tolerance, first.refined().refined(), interrupt)
        return _from_closed(option, market, deterministic, "worthless underlying", tolerance, region)
    solver = make_solver(
        option, market, tolerance, first, lcp_method=lcp_method, tangents=greeks, interrupt=interrupt
    )
    if resolution is None:
        estimate = estimate_to_tolerance(solver, tolerance, first)
    else:
        estimate = estimate_at_resolution(solver, first)
    if estimate is None:
        return without_price(option, market)
    if deterministic.error <= estimate.error * option.strike:
        return _from_closed(option, market, deterministic, "zero volatility", tolerance)
    if estimate.region.is_open_at_strike(option):
        near = region_near_strike(option, market, tolerance, estimate.solution.resolution, interrupt)
        estimate = replace(estimate, region=estimate.region.completed_by(near))
    return _from_estimate(option, market, estimate, tolerance, lcp_method, greeks)


def _first_resolution(
    option: Option, market: Market, method: Method, resolution: Resolution | None
) -> Resolution:
    """Return the resolution to begin with, its scheme settled between `method` and `resolution`."""
    wanted = None if resolution is None else resolution.scheme
    if (
        method != "auto"
        and wanted is not None
        and (wanted == "crank-nicolson") != (method == "crank-nicolson")
    ):
        raise InvalidInputError(
            "method", method, f'"auto" where the resolution asks for the scheme "{wanted}"'
        )
    scheme: Scheme = wanted or ("crank-nicolson" if method == "crank-nicolson" else "sdirk2")
    if resolution is None:
        return coarsest_resolution(option, market, scheme)
    return replace(resolution, scheme=scheme)


def _from_estimate(
    option: Option, market: Market, estimate: Estimate, tolerance: float, lcp_method: str, greeks: bool
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
        market,
        closed,
        estimate.region,
        exercise_now=estimate.exercised and option.payoff(market.spot) > 0.0,
        status="deadline" if estimate.interrupted else status,
        method=resolution.scheme or "",
        diagnostics=diagnostics,
    )


def _not_below(bound: float, closed: ClosedValue) -> ClosedValue:
    """Lift the value to what it cannot be less than; what was missing counts as error."""
    missing = bound - closed.value
    return closed if missing <= 0.0 else replace(closed, value=bound, error=max(closed.error, missing))


def _held(option: Option, market: Market, estimate: Estimate, error: float) -> ClosedValue:
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


def _from_closed(
    option: Option,
    market: Market,
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
        market,
        closed,
        region,
        exercise_now=exercise_now,
        status="ok" if closed.error <= tolerance * option.strike else "tolerance_not_met",
        method=solved_by.replace(" ", "-"),
        diagnostics=Diagnostics(solved_by),
    )


def check_moneyness(option: Option, market: Market) -> None:
    """Raise InvalidInputError where spot and strike are so far apart that their ratio's powers overflow."""
    if market.spot > 0.0 and not 1.0 / LARGEST_RATIO <= market.spot / option.strike <= LARGEST_RATIO:
        allowed = f"0, or between {1.0 / LARGEST_RATIO:g} and {LARGEST_RATIO:g} times the strike"
        raise InvalidInputError("spot", market.spot, allowed)


def _check_choice(field: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InvalidInputError(field, value, "one of " + ", ".join(f'"{choice}"' for choice in allowed))
