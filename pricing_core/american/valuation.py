"""Price one option: value, Greeks, exercise boundary and an honest error estimate."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

from pricing_core.american.book import single_row
from pricing_core.american.book_values import MARCHED, value_book
from pricing_core.american.contract import Option, check_kind, real_number
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
from pricing_core.american.tolerances import (
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
    check_moneyness,
)
from pricing_core.american.tridiagonal_step import LCPMethod
from pricing_core.errors import InvalidInputError

Method: TypeAlias = Literal["auto", "lcs", "crank-nicolson"]
MARCH_METHOD = "premium-march"


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
    Schumacher's chapter on complementarity systems, for the early exercise premium, at three or more resolutions,
    and extrapolated; European ones, and those never exercised early, by the closed formula.

    Parameters
    ----------
    option : Option
    market : Market
    tolerance : float
        Absolute error of the price as a fraction of the strike, 1e-8 to 1e-2.
    method : {"auto", "lcs", "crank-nicolson"}
        "auto" is the compiled march of the premium in a frame that moves with the exercise boundary, wherever there
        is one boundary that its grid resolves, else "lcs": the general path on a fixed grid, stepped by SDIRK2.
        "crank-nicolson" is that path stepped by Crank and Nicolson's method.
    lcp_method : {"tridiagonal", "policy", "psor", "lemke"}
        The solver of each step's complementarity problem on the general path; one other than "tridiagonal" takes
        "auto" there.
    greeks : bool
        False leaves out vega, rho and dividend rho, which cost more than the price.
    resolution : Resolution, optional
        Solve at exactly this grid and these steps on the general path, once, without extrapolation; the error is
        estimated from a second solve with half as many of each.
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
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    check_kind("greeks", greeks, bool, "True or False")
    _check_choice("method", method, ("auto", "lcs", "crank-nicolson"))
    _check_choice("lcp_method", lcp_method, ("tridiagonal", "policy", "psor", "lemke"))
    check_moneyness(option, market)
    if method == "auto" and lcp_method == "tridiagonal" and resolution is None:
        if interrupt is not None and interrupt():
            return without_price(option, market)
        marched = march_value(option, market, tolerance, greeks)
        if marched is not None:
            return marched
    return price_alone(
        option,
        market,
        tolerance=tolerance,
        method=method,
        lcp_method=lcp_method,
        greeks=greeks,
        resolution=resolution,
        interrupt=interrupt,
    )


def price_alone(
    option: Option,
    market: Market,
    *,
    tolerance: float,
    method: Method = "auto",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: bool = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price one option, its arguments checked, without the march: by a formula or on the general path.

    Parameters, returns and raises are those of `price`.
    """
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


def march_value(option: Option, market: Market, tolerance: float, greeks: bool) -> Valuation | None:
    """Return the march's valuation; None where the march does not serve the option."""
    if option.exercise == "european":
        return None
    values = value_book(single_row(option, market, tolerance), greeks=greeks, threads=1, shared=False)
    if values.path[0] != MARCHED:
        return None
    boundary = math.log(values.boundary.item(0) / option.strike)
    closed = ClosedValue(
        *(getattr(values, name).item(0) for name in ("value", "delta", "gamma", "theta")),
        *(getattr(values, name).item(0) for name in ("vega", "rho", "dividend_rho", "error")),
    )
    return assemble(
        option,
        market,
        closed,
        ExerciseRegion(-math.inf, boundary) if option.is_put else ExerciseRegion(boundary, math.inf),
        exercise_now=values.exercised.item(0),
        status="ok" if closed.error <= tolerance * option.strike else "tolerance_not_met",
        method=MARCH_METHOD,
        diagnostics=Diagnostics("premium march", steps_taken=values.steps.item(0)),
        european=values.european.item(0),
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


def _check_choice(field: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InvalidInputError(field, value, "one of " + ", ".join(f'"{choice}"' for choice in allowed))
