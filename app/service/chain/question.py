"""The parameters of a fit, which stand in the query of its address beside the quotes in the body."""

from dataclasses import dataclass
from typing import Any

from fastapi import Request

from app.service.errors import InvalidRequestError
from app.service.query_parameters import query_parameters
from pricing_core.american.contracts.fields import RATE, TOLERANCE
from pricing_core.american.contracts.json_text import parse_cell
from pricing_core.chains import vendor_maps
from pricing_core.chains.expiry_time import valuation_moment
from pricing_core.errors import InvalidInputError, MissingInputError, Told
from pricing_core.plain_number import read_number

MOST_DIVIDENDS = 64  # chosen
FORMATS = ("auto", *vendor_maps())


@dataclass(frozen=True, slots=True)
class ChainQuestion:
    """The parameters of a fit, see `read_chain` and `fit_chain`; what is None was not given."""

    format: str
    rate: Any
    cash_dividends: list[Any]
    valuation_date: str | None
    underlying_price: float | None
    tolerance: float


def _parameter(name: str, description: str, schema: dict[str, Any], **example: float) -> dict[str, Any]:
    """Return the description of a parameter; those with an example are required."""
    return {
        "name": name,
        "in": "query",
        "required": bool(example),
        "description": description,
        "schema": schema,
        **example,
    }


TEXT = {"type": "string"}
PARAMETERS = [
    _parameter("rate", f"{RATE.description} A number, or the JSON of a curve.", TEXT, example=0.04),
    _parameter("format", "Whose columns the quotes have.", {"enum": [*FORMATS], "default": "auto"}),
    _parameter(
        "cash_dividends",
        'JSON: a list of {"ex_date": ..., "amount": ...}, or with time (years) for ex_date; where an amount is left '
        "out, it is the one that the quotes imply.",
        TEXT,
    ),
    _parameter(
        "valuation_date", "Date, or date-time in local time of the market; the quotes' own by default.", TEXT
    ),
    _parameter(
        "underlying_price", "Money, for quotes that lack it.", {"type": "number", "exclusiveMinimum": 0}
    ),
    _parameter(
        "tolerance",
        TOLERANCE.description,
        {
            "type": "number",
            "minimum": TOLERANCE.least,
            "maximum": TOLERANCE.most,
            "default": TOLERANCE.default,
        },
    ),
]
NAMES = [parameter["name"] for parameter in PARAMETERS]


def chain_question(request: Request) -> ChainQuestion:
    """Read the query of a request.

    Raises
    ------
    InvalidRequestError
        A parameter is missing, unknown, given twice, or not what it must be.
    """
    try:
        return _question(query_parameters(request, NAMES))
    except InvalidInputError as fault:
        raise InvalidRequestError([fault]) from None


def _question(found: dict[str, str]) -> ChainQuestion:
    if "rate" not in found:
        raise MissingInputError({"rate": "1/year"}, "give a number or the JSON of a curve")
    if found.get("format", "auto") not in FORMATS:
        raise InvalidInputError("format", found["format"], f"one of {', '.join(FORMATS)}")
    if "valuation_date" in found:
        valuation_moment(found["valuation_date"])
    spot = found.get("underlying_price")
    if spot is not None and not read_number("underlying_price", spot) > 0.0:
        raise InvalidInputError("underlying_price", spot, "a number above 0")
    return ChainQuestion(
        found.get("format", "auto"),
        _rate(found["rate"]),
        _dividends(found.get("cash_dividends", "[]")),
        found.get("valuation_date"),
        None if spot is None else read_number("underlying_price", spot),
        TOLERANCE.check(read_number("tolerance", found.get("tolerance", TOLERANCE.default))),
    )


def _rate(text: str) -> Any:
    if text.lstrip().startswith("{"):
        return parse_cell("rate", text, RATE.allowed)
    return RATE.check(read_number("rate", text))


def _dividends(text: str) -> list[Any]:
    allowed = f"a JSON list of at most {MOST_DIVIDENDS} dividends"
    found = parse_cell("cash_dividends", text, allowed)
    if (
        not isinstance(found, list)
        or len(found) > MOST_DIVIDENDS
        or not all(isinstance(one, dict) for one in found)
    ):
        raise InvalidInputError("cash_dividends", Told("another JSON text"), allowed)
    return found
