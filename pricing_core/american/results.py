"""What `price` returns, and its assembly from a value, its derivatives and the exercise region."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from pricing_core.american.contracts.contract import Option
from pricing_core.american.flat.limits import ClosedValue
from pricing_core.american.flat.resolution import Resolution
from pricing_core.version import ENGINE_VERSION

Status: TypeAlias = Literal["ok", "tolerance_not_met", "invalid_input", "out_of_domain", "deadline"]
DAYS_PER_YEAR = 365.0


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """How a price was found.

    Parameters
    ----------
    solved_by : str
        "method of lines", "closed form", "zero volatility", "worthless underlying" (spot 0), "expired", or "nothing".
    resolution : Resolution or None
        The finest grid and steps.
    solves : int
        Resolutions solved; the result is extrapolated from the last two where there are two or more.
    steps_taken : int
        Time steps of the finest solve.
    lcp_method : str or None
    lcp_residual : float
        Largest natural residual of the finest solve's complementarity problems.
    fitted : bool
        Exponential fitting was needed (the drift dominates the diffusion on the finest grid): first order
        only.
    """

    solved_by: str
    resolution: Resolution | None = None
    solves: int = 0
    steps_taken: int = 0
    lcp_method: str | None = None
    lcp_residual: float = 0.0
    fitted: bool = False


@dataclass(frozen=True, slots=True)
class Valuation:
    """The result of `price`. Money per unit of underlying; None where a number is missing.

    Parameters
    ----------
    price, european_price, early_exercise_premium, intrinsic_value : float
    delta, gamma : float
        dV/dS, d2V/dS2.
    theta, theta_per_day : float
        dV/dt in calendar time, per year and per 1/365 year.
    vega, vega_per_point, rho, rho_per_point, dividend_rho : float
        Per 1.00 of volatility, rate and yield, a curve shifted as a whole; per point: per 0.01.
    dividend_sensitivities : tuple of float or None
        dV/d amount of each of the market's cash dividends, in their order (that of time).
    vanna, volga : float or None
        d delta/d volatility and d vega/d volatility; with extended Greeks only, as the next two.
    rate_bucket_rho, volatility_bucket_vega : tuple of float or None
        dV by each of the values of the curve; None where it is none.
    exercise_now : bool
        The intrinsic value is positive and the spot lies in the closed exercise region.
    exercise_boundary : float or None
        S* now, where there are two the one nearer the strike (see `exercise_boundary` for both); None where
        exercise is never optimal.
    error_estimate : float
        Of the price, absolute, money.
    status : str
        "ok", "tolerance_not_met" or "deadline".
    method : str
        "premium-march"; "multiplier-collocation" with events; the time stepping on the general path; or what took
        their place: "closed-form", "zero-volatility", "worthless-underlying", "expired", "none".
    engine_version : str
    diagnostics : Diagnostics
    """

    price: float | None
    european_price: float | None
    early_exercise_premium: float | None
    intrinsic_value: float
    delta: float | None
    gamma: float | None
    theta: float | None
    theta_per_day: float | None
    vega: float | None
    vega_per_point: float | None
    rho: float | None
    rho_per_point: float | None
    dividend_rho: float | None
    dividend_sensitivities: tuple[float, ...] | None
    vanna: float | None
    volga: float | None
    rate_bucket_rho: tuple[float, ...] | None
    volatility_bucket_vega: tuple[float, ...] | None
    exercise_now: bool
    exercise_boundary: float | None
    error_estimate: float | None
    status: Status
    method: str
    engine_version: str
    diagnostics: Diagnostics


@dataclass(frozen=True, slots=True)
class FurtherGreeks:
    """Derivatives that flat markets lack, or that are asked for; money per unit of underlying."""

    dividend_sensitivities: tuple[float, ...] | None = None
    vanna: float = math.nan
    volga: float = math.nan
    rate_bucket_rho: tuple[float, ...] | None = None
    volatility_bucket_vega: tuple[float, ...] | None = None


NO_FURTHER_GREEKS = FurtherGreeks()


def assemble(
    option: Option,
    spot: float,
    closed: ClosedValue,
    *,
    european: float,
    boundary: float,
    exercise_now: bool,
    status: Status,
    method: str,
    diagnostics: Diagnostics,
    further: FurtherGreeks = NO_FURTHER_GREEKS,
) -> Valuation:
    """Return the valuation with everything that follows from value, derivatives and boundary; NaN becomes None."""
    return Valuation(
        price=_present(closed.value),
        european_price=_present(european),
        early_exercise_premium=_present(closed.value - european),
        intrinsic_value=option.payoff(spot),
        delta=_present(closed.delta),
        gamma=_present(closed.gamma),
        theta=_present(closed.theta),
        theta_per_day=_present(closed.theta / DAYS_PER_YEAR),
        vega=_present(closed.vega),
        vega_per_point=_present(closed.vega / 100.0),
        rho=_present(closed.rho),
        rho_per_point=_present(closed.rho / 100.0),
        dividend_rho=_present(closed.dividend_rho),
        dividend_sensitivities=further.dividend_sensitivities,
        vanna=_present(further.vanna),
        volga=_present(further.volga),
        rate_bucket_rho=further.rate_bucket_rho,
        volatility_bucket_vega=further.volatility_bucket_vega,
        exercise_now=bool(exercise_now),
        exercise_boundary=_present(boundary),
        error_estimate=_present(closed.error),
        status=status,
        method=method,
        engine_version=ENGINE_VERSION,
        diagnostics=diagnostics,
    )


def without_price(option: Option, spot: float, european: float) -> Valuation:
    """Return a valuation without a price: the deadline came before anything could be estimated."""
    return assemble(
        option,
        spot,
        ClosedValue(*[math.nan] * 8),
        european=european,
        boundary=math.nan,
        exercise_now=False,
        status="deadline",
        method="none",
        diagnostics=Diagnostics("nothing"),
    )


def _present(number: float) -> float | None:
    return None if math.isnan(number) else number + 0.0  # no -0.0
