"""What the OpenAPI description says of /v1/batch."""

from typing import Any

from app.service.batch.answers import ARROW, JSON, LINES
from app.service.batch.question import PARAMETERS
from app.service.batch.row_limits import FIELDS, LONGEST_COLUMNS, MOST_JSON_ROWS, MOST_ROWS
from app.service.json_schema import inline_schema
from app.service.schemas import PriceRequest
from pricing_core.american.contracts.result_fields import UNITS_FIELD, ResultField, price_fields

EXAMPLE = {
    "option_type": ["put", "call"],
    "spot": [90.0, 110.0],
    "strike": 100.0,
    "expiry": 1.0,
    "rate": 0.05,
    "volatility": 0.2,
}
ROWS = [
    {name: cells[row] if isinstance(cells, list) else cells for name, cells in EXAMPLE.items()}
    for row in range(2)
]
# By the kind of an output: its JSON type.
TYPES: dict[str, dict[str, Any]] = {
    "number": {"type": ["number", "null"]},
    "count": {"type": "integer"},
    "flag": {"type": ["boolean", "null"]},
    "text": {"type": ["string", "null"]},
    "list": {"type": ["array", "null"], "items": {"type": ["number", "null"]}},
}
MESSAGE = ResultField("message", "text", "", "Why a row has no price", None)


def _row() -> dict[str, Any]:
    """Return the schema of a row: that of a question for one price, without what holds for all rows."""
    properties = inline_schema(PriceRequest)["properties"]
    return {name: properties[name] for name in FIELDS}


def _columns() -> dict[str, Any]:
    """Return the schema of columns of cells, or of one cell for all rows."""
    properties = {
        name: {
            "description": schema.get("description", ""),
            "anyOf": [schema, {"type": "array", "items": schema, "maxItems": MOST_JSON_ROWS}],
        }
        for name, schema in _row().items()
    }
    required = [name for name, field in FIELDS.items() if field.required and name != "expiry"]
    return {
        "type": "object",
        "description": f"At most {LONGEST_COLUMNS:,} bytes, and {MOST_JSON_ROWS:,} rows.",
        "properties": properties,
        "required": required,
        "anyOf": [{"required": ["expiry"]}, {"required": ["valuation_date", "expiration_date"]}],
        "additionalProperties": False,
        "examples": [EXAMPLE],
    }


def _results() -> dict[str, Any]:
    """Return the schema of columns of results."""
    units = {"enum": [*UNITS_FIELD.choices], "description": UNITS_FIELD.description}
    fields = (*price_fields("extended", greek_errors=True, advice=True), MESSAGE)
    columns = {
        field.name: {"type": "array", "items": TYPES[field.kind], "description": field.description}
        for field in fields
    }
    required = ["greeks_units", *(field.name for field in price_fields("none", ())), "message"]
    return {"type": "object", "properties": {"greeks_units": units, **columns}, "required": required}


BINARY = {"type": "string", "format": "binary"}
BATCH_OPERATION: dict[str, Any] = {
    "parameters": PARAMETERS,
    "requestBody": {
        "required": True,
        "content": {
            JSON: {"schema": _columns()},
            LINES: {
                "schema": {
                    "type": "string",
                    "description": f"One object of columns' cells on each line; at most {MOST_ROWS:,} lines.",
                }
            },
            ARROW: {"schema": BINARY},
        },
    },
}
BATCH_RESPONSE: dict[str, Any] = {
    "description": "The results of every row, in order.",
    "content": {
        JSON: {"schema": _results()},
        LINES: {"schema": {"type": "string"}},
        ARROW: {"schema": BINARY},
    },
}
