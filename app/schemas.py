"""Requests and responses, with units, ranges and examples."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ConfigDict, Field, JsonValue

from app.contract_schema import Contract, Money, Strict, Time, VolatilityOrCurve

LARGEST_TIMES = 1_000  # of one boundary request
VOLATILITY = "Volatility per square root of a year; or a curve."
EXAMPLE: Mapping[str, JsonValue] = {
    "option_type": "put",
    "spot": 100.0,
    "strike": 100.0,
    "expiry": 1.0,
    "rate": 0.05,
    "volatility": 0.2,
}


def _example(without: tuple[str, ...] = (), **others: JsonValue) -> ConfigDict:
    given = {name: value for name, value in EXAMPLE.items() if name not in without}
    examples: list[JsonValue] = [{**given, **others}]
    return ConfigDict(json_schema_extra={"examples": examples})


class PriceRequest(Contract):
    """One option in one market."""

    model_config = _example()

    spot: Money = Field(description="Money per unit of the underlying.", examples=[100.0])
    volatility: VolatilityOrCurve = Field(description=VOLATILITY, examples=[0.2])
    greeks: Literal["standard", "extended"] = Field(
        "standard",
        description="extended adds vanna, volga, and rho and vega by the pieces of a curve.",
        examples=["standard"],
    )


class BoundaryRequest(Contract):
    """One option in one market, and the times at which its exercise boundary is asked for."""

    model_config = _example(times=[0.0, 0.5, 1.0])

    spot: Money | None = Field(
        None,
        description="Accepted and checked; the boundary does not depend on it.",
        examples=[100.0],
    )
    volatility: VolatilityOrCurve = Field(description=VOLATILITY, examples=[0.2])
    times: list[Time] | None = Field(
        None,
        min_length=1,
        max_length=LARGEST_TIMES,
        description="Calendar times from now in years, increasing, 0 to expiry; a default set if absent.",
        examples=[[0.0, 0.5, 1.0]],
    )


class ImpliedVolatilityRequest(Contract):
    """One option, its market without volatility, and what the option costs there."""

    model_config = _example(without=("volatility",), option_price=6.09)

    spot: Money = Field(description="Money per unit of the underlying.", examples=[100.0])
    volatility: VolatilityOrCurve | None = Field(
        None, description="Accepted and checked; not used.", examples=[0.2]
    )
    option_price: Money | None = Field(
        None, description="Money; given unless bid and ask are.", examples=[6.09]
    )
    bid: Money | None = Field(None, description="Money.", examples=[6.0])
    ask: Money | None = Field(None, description="Money.", examples=[6.2])


def _number(description: str, example: float) -> Any:
    return Field(description=f"{description} null where it is missing.", examples=[example])


def _numbers(description: str, example: list[float]) -> Any:
    return Field(description=f"{description} null where they are missing.", examples=[example])


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
    vanna: float | None = _number("d2V/dS dvolatility; extended Greeks alone.", -0.3)
    volga: float | None = _number("d2V/dvolatility2, money; extended Greeks alone.", 11.0)
    rate_bucket_rho: tuple[float, ...] | None = _numbers(
        "dV/d each value of a curve of rates, money per 1.00; extended Greeks alone.", [-12.0, -8.0]
    )
    volatility_bucket_vega: tuple[float, ...] | None = _numbers(
        "dV/d each value of a curve of volatilities, money per 1.00; extended Greeks alone.", [20.0, 17.8]
    )
    dividend_sensitivities: tuple[float, ...] | None = _numbers(
        "dV/d amount of each cash dividend, in the order of their times.", [0.5]
    )


class ImpliedVolatilityResponse(Strict):
    """The volatility at which the option is worth its price."""

    volatility: float | None = _number("Per square root of a year.", 0.2)
    status: str = Field(
        description="ok, below_lower_bound, above_upper_bound, not_identifiable (the price is the intrinsic value "
        "where the holder exercises), no_convergence or invalid_input.",
        examples=["ok"],
    )
    european_price: float | None = _number("Value without early exercise at that volatility, money.", 5.57)
    price: float | None = _number("Value at that volatility, money.", 6.09)
    bid_volatility: float | None = _number("At which the option is worth its bid.", 0.198)
    ask_volatility: float | None = _number("At which the option is worth its ask.", 0.202)
    error_estimate: float | None = _number("Estimated absolute error of that price, money.", 1e-6)
    iterations: int = Field(description="Times that the option was priced.", examples=[4])


class BoundaryResponse(Strict):
    """The exercise boundary at each time; null where exercise is not optimal at any spot."""

    time: list[float] = Field(description="Calendar time from now in years.", examples=[[0.0, 1.0]])
    time_to_expiry: list[float] = Field(description="expiry - time, years.", examples=[[1.0, 0.0]])
    boundary: list[float | None] = Field(description="Critical spot, money.", examples=[[81.0, 100.0]])
    other_boundary: list[float | None] | None = Field(
        description="The farther end of the exercise region where it has two, money.", examples=[None]
    )
    error_estimate: list[float | None] = Field(
        description="Estimated absolute error of boundary, money; null where there is none.",
        examples=[[0.0004, 0.0]],
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
    """RFC 9457 problem details; of the input they repeat the names of keys, and numbers."""

    type: str = Field(examples=["/docs#invalid-input"])
    title: str = Field(examples=["A field is not what it must be"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["volatility = -0.2: must be a number from 0 to 15"])
    errors: list[FieldError] = Field(default_factory=list)
    request_id: str = Field(examples=["5f0c..."], description="Also in the X-Request-ID header and the log.")
