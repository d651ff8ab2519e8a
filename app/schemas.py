"""Requests and responses, with units, ranges and examples; the ranges are the library's own."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from pricing_core.american.contract import LARGEST_EXPIRY, LARGEST_MONEY, SMALLEST_MONEY, Exercise, OptionType
from pricing_core.american.market import LARGEST_RATE, LARGEST_VOLATILITY, SMALLEST_RATE
from pricing_core.american.tolerances import DEFAULT_TOLERANCE, LARGEST_TOLERANCE, SMALLEST_TOLERANCE

LARGEST_TIMES = 1_000  # of one boundary request

Spot = Annotated[float, Field(ge=0.0, le=LARGEST_MONEY)]
Rate = Annotated[float, Field(ge=SMALLEST_RATE, le=LARGEST_RATE)]
Time = Annotated[float, Field(ge=0.0, le=LARGEST_EXPIRY)]


class Strict(BaseModel):
    """Numbers are finite numbers, not strings or booleans; unknown keys are refused; nothing is coerced."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Contract(Strict):
    """What both questions hold: the option and the market without its spot."""

    option_type: OptionType = Field(description="The right to sell (put) or to buy (call).", examples=["put"])
    strike: float = Field(
        ge=SMALLEST_MONEY,
        le=LARGEST_MONEY,
        description="Money per unit of the underlying.",
        examples=[100.0],
    )
    expiry: Time = Field(description="Time to expiry in years.", examples=[1.0])
    rate: Rate = Field(description="Risk-free rate per year, continuously compounded.", examples=[0.05])
    volatility: float = Field(
        ge=0.0, le=LARGEST_VOLATILITY, description="Volatility per square root of a year.", examples=[0.2]
    )
    dividend_yield: Rate = Field(
        0.0, description="Continuous yield per year; the cost of borrowing adds to it.", examples=[0.0]
    )
    exercise: Exercise = Field(
        "american",
        description="american: at any time up to expiry; european: at expiry.",
        examples=["american"],
    )
    tolerance: float = Field(
        DEFAULT_TOLERANCE,
        ge=SMALLEST_TOLERANCE,
        le=LARGEST_TOLERANCE,
        description="Absolute error of the price allowed, as a fraction of the strike.",
        examples=[1e-6],
    )


class PriceRequest(Contract):
    """One option in one market."""

    spot: Spot = Field(description="Money per unit of the underlying.", examples=[100.0])


class BoundaryRequest(Contract):
    """One option in one market, and the times at which its exercise boundary is asked for."""

    spot: Spot | None = Field(
        None,
        description="Accepted and checked; the boundary does not depend on it.",
        examples=[100.0],
    )
    times: list[Time] | None = Field(
        None,
        min_length=1,
        max_length=LARGEST_TIMES,
        description="Calendar times from now in years, increasing, 0 to expiry; a default set if absent.",
        examples=[[0.0, 0.5, 1.0]],
    )


def _number(description: str, example: float) -> Any:
    return Field(description=f"{description} null where it is missing.", examples=[example])


class PriceResponse(Strict):
    """The value of the option, its sensitivities, and how far to trust them."""

    price: float | None = _number("Value now, money.", 6.09)
    european_price: float | None = _number("Value without early exercise, money.", 5.57)
    early_exercise_premium: float | None = _number("price - european_price, money.", 0.52)
    intrinsic_value: float | None = _number("What exercise brings now, money.", 0.0)
    delta: float | None = _number("dV/dS.", -0.41)
    gamma: float | None = _number("d2V/dS2, per unit of money.", 0.023)
    theta: float | None = _number("dV/dt in calendar time, money per year.", -2.3)
    theta_per_day: float | None = _number("theta/365.", -0.0063)
    vega: float | None = _number("dV/dvolatility, money per 1.00.", 37.8)
    vega_per_point: float | None = _number("vega/100.", 0.378)
    rho: float | None = _number("dV/drate, money per 1.00.", -30.3)
    rho_per_point: float | None = _number("rho/100.", -0.303)
    dividend_rho: float | None = _number("dV/ddividend_yield, money per 1.00.", 24.2)
    exercise_now: bool | None = Field(
        description="Whether the holder does best to exercise now.", examples=[False]
    )
    exercise_boundary: float | None = _number("The spot at which to exercise now, money.", 81.0)
    error_estimate: float | None = _number("Estimated absolute error of the price, money.", 2e-5)
    status: str = Field(
        description="ok, tolerance_not_met (a price with its honest estimate), out_of_domain or deadline.",
        examples=["ok"],
    )
    method: str = Field(description="How the price was computed.", examples=["lcs"])
    engine_version: str = Field(description="Version of the pricing engine.", examples=["0.1.0"])


class BoundaryResponse(Strict):
    """The exercise boundary at each time; null where exercise is not optimal at any spot."""

    time: list[float] = Field(description="Calendar time from now in years.", examples=[[0.0, 1.0]])
    time_to_expiry: list[float] = Field(description="expiry - time, years.", examples=[[1.0, 0.0]])
    boundary: list[float | None] = Field(description="Critical spot, money.", examples=[[81.0, 100.0]])
    other_boundary: list[float | None] | None = Field(
        description="The farther end of the exercise region where it has two, money.", examples=[None]
    )


class HealthResponse(Strict):
    """State of the process and the build it runs."""

    status: str = Field(description="alive or ready.", examples=["ready"])
    version: str = Field(description="Version of the distribution.", examples=["0.1.0"])
    kernel: str = Field(
        description="rust where the compiled kernel is in use, else numpy.", examples=["rust"]
    )


class FieldError(Strict):
    """One field and what it must be."""

    field: str
    allowed: str


class Problem(Strict):
    """RFC 9457 problem details; the input is never repeated."""

    type: str = Field(examples=["/docs#invalid-input"])
    title: str = Field(examples=["A field is not what it must be"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["volatility must be a number from 0 to 15"])
    errors: list[FieldError] = Field(default_factory=list)
    request_id: str = Field(examples=["5f0c..."], description="Also in the X-Request-ID header and the log.")
