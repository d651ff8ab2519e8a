"""The settings of all rows of a batch, which stand in the query of its address."""

from typing import Any, NamedTuple

from fastapi import Request

from app.service.errors import InvalidRequestError
from app.service.query_parameters import query_parameters
from pricing_core.american.contracts.fields import (
    ADVICE,
    GREEK_ERRORS,
    GREEKS,
    GREEKS_UNITS,
    TOLERANCE,
    GreeksUnits,
)
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import read_number

FLAGS = {"true": True, "false": False}


class BatchQuestion(NamedTuple):
    """The settings of all rows, and the units of their Greeks."""

    settings: PricingSettings
    units: GreeksUnits


def _parameter(name: str, description: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, "in": "query", "required": False, "description": description, "schema": schema}


PARAMETERS = [
    _parameter(
        "tolerance",
        f"{TOLERANCE.description} For rows without one of their own.",
        {
            "type": "number",
            "minimum": TOLERANCE.least,
            "maximum": TOLERANCE.most,
            "default": TOLERANCE.default,
        },
    ),
    _parameter("greeks", GREEKS.description, {"enum": [*GREEKS.choices], "default": GREEKS.default}),
    _parameter("greek_errors", GREEK_ERRORS.description, {"type": "boolean", "default": False}),
    _parameter("advice", ADVICE.description, {"type": "boolean", "default": False}),
    _parameter(
        "greeks_units",
        GREEKS_UNITS.description,
        {"enum": [*GREEKS_UNITS.choices], "default": GREEKS_UNITS.default},
    ),
]
NAMES = [parameter["name"] for parameter in PARAMETERS]


def batch_question(request: Request) -> BatchQuestion:
    """Read the query of a request.

    Raises
    ------
    InvalidRequestError
        A parameter is unknown, given twice, or not what it must be.
    """
    try:
        found = query_parameters(request, NAMES)
        units = _choice("greeks_units", found, GREEKS_UNITS.choices, GREEKS_UNITS.default)
        settings = PricingSettings(
            TOLERANCE.check(read_number("tolerance", found.get("tolerance", TOLERANCE.default))),
            _choice("greeks", found, GREEKS.choices, GREEKS.default),
            FLAGS[_choice("greek_errors", found, tuple(FLAGS), "false")],
            advice=FLAGS[_choice("advice", found, tuple(FLAGS), "false")],
        )
    except InvalidInputError as fault:
        raise InvalidRequestError([fault]) from None
    return BatchQuestion(settings, units)


def _choice(name: str, given: dict[str, str], choices: tuple[str, ...], default: str) -> Any:
    value = given.get(name, default).strip().lower()
    if value not in choices:
        raise InvalidInputError(name, value, " or ".join(choices))
    return value
