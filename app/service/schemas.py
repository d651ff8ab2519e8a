"""Requests and responses, with units, ranges and examples."""

from typing import Annotated

from pydantic import ConfigDict, Field, JsonValue

from app.service.answers import answer_model
from app.service.contract_schema import (
    Contract,
    Greeks,
    GreeksUnits,
    Strict,
    VolatilityOrCurve,
    limits,
    stated,
)
from pricing_core.american.contracts import fields
from pricing_core.american.contracts.result_fields import (
    ADVICE_FIELDS,
    BOUNDARY_FIELDS,
    ERROR_FIELDS,
    IMPLIED_VOLATILITY_FIELDS,
    PRICE_FIELDS,
    PROVENANCE_FIELDS,
    SURFACE_FIELDS,
    UNITS_FIELD,
)
from pricing_core.american.surface import SurfaceGreeks
from pricing_core.version import ENGINE_VERSION

LARGEST_TIMES = (
    1_000  # Largest number of times in a request for a boundary, an advice or a surface, and of spots.
)

NULL: JsonValue = {"type": "null"}
# What JSON schema cannot say of one key alone: either the expiry is given, or both dates are.
EXPIRY_OR_DATES: list[JsonValue] = [
    {
        "required": ["expiry"],
        "properties": {"expiry": {"type": "number"}, "valuation_date": NULL, "expiration_date": NULL},
    },
    {
        "required": ["valuation_date", "expiration_date"],
        "properties": {
            "expiry": NULL,
            "valuation_date": {"type": "string"},
            "expiration_date": {"type": "string"},
        },
    },
]


def _example(without: tuple[str, ...] = (), **others: JsonValue) -> ConfigDict:
    required = [field for field in fields.CONTRACT_FIELDS if field.required and field.name not in without]
    examples: list[JsonValue] = [{field.name: field.example for field in required} | others]
    return ConfigDict(json_schema_extra={"examples": examples, "oneOf": EXPIRY_OR_DATES})


class PriceRequest(Contract):
    """One option in one market."""

    model_config = _example()

    spot: float = stated(fields.SPOT)
    volatility: VolatilityOrCurve = stated(fields.VOLATILITY)
    greeks: Greeks = stated(fields.GREEKS)
    greek_errors: bool = stated(fields.GREEK_ERRORS)
    greeks_units: GreeksUnits = stated(fields.GREEKS_UNITS)


class BoundaryRequest(Contract):
    """One option in one market, and the times at which its exercise boundary is asked for."""

    model_config = _example(times=[0.0, 0.5, 1.0])

    spot: float | None = stated(
        fields.SPOT, default=None, description="Accepted and checked; the boundary does not depend on it."
    )
    volatility: VolatilityOrCurve = stated(fields.VOLATILITY)
    times: list[Annotated[float, limits(fields.BOUNDARY_TIMES)]] | None = stated(
        fields.BOUNDARY_TIMES, min_length=1, max_length=LARGEST_TIMES
    )


class AdviceRequest(Contract):
    """One option in one market, and the times at which probabilities and costs are asked for."""

    model_config = _example(times=[0.5, 1.0])

    spot: float = stated(fields.SPOT)
    volatility: VolatilityOrCurve = stated(fields.VOLATILITY)
    times: list[Annotated[float, limits(fields.BOUNDARY_TIMES)]] | None = stated(
        fields.BOUNDARY_TIMES, min_length=1, max_length=LARGEST_TIMES
    )


class ImpliedVolatilityRequest(Contract):
    """One option, its market without volatility, and what the option costs there."""

    model_config = _example(without=("volatility",), option_price=6.09)

    spot: float = stated(fields.SPOT)
    volatility: VolatilityOrCurve | None = stated(
        fields.VOLATILITY, default=None, description="Accepted and checked; not used."
    )
    option_price: float | None = stated(fields.OPTION_PRICE)
    bid: float | None = stated(fields.BID)
    ask: float | None = stated(fields.ASK)


class SurfaceRequest(Contract):
    """One option, and the times and spots at which it is valued."""

    model_config = _example(
        without=("spot",), spots=fields.SURFACE_SPOTS.example, times=fields.SURFACE_TIMES.example
    )

    spot: float | None = stated(
        fields.SPOT, default=None, description="Accepted and checked; the spots stand in its place."
    )
    volatility: VolatilityOrCurve = stated(fields.VOLATILITY)
    spots: list[Annotated[float, limits(fields.SURFACE_SPOTS)]] = stated(
        fields.SURFACE_SPOTS, min_length=1, max_length=LARGEST_TIMES
    )
    times: list[Annotated[float, limits(fields.SURFACE_TIMES)]] = stated(
        fields.SURFACE_TIMES, min_length=1, max_length=LARGEST_TIMES
    )
    greeks: SurfaceGreeks = stated(
        fields.GREEKS, description="standard: delta, gamma, theta and vega at every point; none: no Greek."
    )
    greeks_units: GreeksUnits = stated(fields.GREEKS_UNITS)


PriceResponse = answer_model(
    "PriceResponse",
    "The value of the option, its sensitivities, and how far to trust them.",
    (*PRICE_FIELDS, UNITS_FIELD),
    ERROR_FIELDS,
)
ImpliedVolatilityResponse = answer_model(
    "ImpliedVolatilityResponse",
    "The volatility at which the option is worth its price.",
    (*IMPLIED_VOLATILITY_FIELDS, *PROVENANCE_FIELDS),
)
BoundaryResponse = answer_model(
    "BoundaryResponse", "The exercise boundary at each time.", (*BOUNDARY_FIELDS, *PROVENANCE_FIELDS)
)
AdviceResponse = answer_model(
    "AdviceResponse",
    "When the option will be exercised, and what waiting costs.",
    (*ADVICE_FIELDS, *PROVENANCE_FIELDS),
)
SurfaceResponse = answer_model(
    "SurfaceResponse",
    "The option held to each time and seen from each spot.",
    (*SURFACE_FIELDS, UNITS_FIELD, *PROVENANCE_FIELDS),
)


class HealthResponse(Strict):
    """State of the process and the build it runs."""

    status: str = Field(description="alive or ready.", examples=["ready"])
    version: str = Field(description="Version of the distribution.", examples=[ENGINE_VERSION])
    kernel: str = Field(
        description="rust where the compiled kernel is in use, else numpy.", examples=["rust"]
    )


class FieldError(Strict):
    """One field and what it must be."""

    field: str
    allowed: str


class Problem(Strict):
    """RFC 9457 problem details, which repeat nothing of the input."""

    type: str = Field(examples=["/docs#invalid-input"])
    title: str = Field(examples=["A field is not what it must be"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["volatility must be a number from 0 to 15"])
    errors: list[FieldError] = Field(default_factory=list)
    request_id: str = Field(examples=["5f0c..."], description="Also in the X-Request-ID header and the log.")
