"""The JSON schema of a max-plus model file."""

from collections.abc import Mapping
from typing import Any

from pricing_core.max_plus.model_file import MOST_STEPS, NAME

_ENTRY = {"anyOf": [{"type": "number"}, {"type": "null"}, {"const": "-inf"}]}
_VECTOR = {"type": "array", "minItems": 1, "items": _ENTRY}
_MATRIX = {"type": "array", "minItems": 1, "items": _VECTOR}
_NAMES = {"type": "array", "items": {"type": "string", "minLength": 1}, "uniqueItems": True}
_PLACE = {
    "type": "object",
    "properties": {
        "source": {"type": "string"},
        "target": {"type": "string"},
        "holding": {"type": "number", "minimum": 0, "default": 0},
        "tokens": {"type": "integer", "minimum": 0, "default": 0},
    },
    "required": ["source", "target"],
    "additionalProperties": False,
}
_PLACE_LIST = {
    "type": "array",
    "minItems": 3,
    "maxItems": 4,
    "description": "source, target, holding, tokens",
}
_COMMON = {
    "model": {"const": NAME},
    "steps": {"type": "integer", "minimum": 1, "maximum": MOST_STEPS, "description": "events to compute"},
    "x0": {**_VECTOR, "description": "times of the events with number 0"},
    "u": {**_MATRIX, "description": "a row of input times for each step"},
}

MODEL_SCHEMA: Mapping[str, Any] = {
    "title": "A max-plus linear system x(k+1) = A x(k) + B u(k), or a timed event graph",
    "oneOf": [
        {
            "title": 'matrices, with null or "-inf" for epsilon',
            "type": "object",
            "properties": {
                **_COMMON,
                "A": {**_MATRIX, "description": "(n, n)"},
                "A0": {**_MATRIX, "description": "(n, n), for x(k+1) = A0 x(k+1) + A x(k) + B u(k)"},
                "B": {**_MATRIX, "description": "(n, m)"},
                "C": {**_MATRIX, "description": "(p, n)"},
                "names": _NAMES,
                "output_names": _NAMES,
            },
            "required": ["model", "A", "x0", "steps"],
            "additionalProperties": False,
        },
        {
            "title": "timed event graph",
            "type": "object",
            "properties": {
                **_COMMON,
                "transitions": _NAMES,
                "places": {"type": "array", "items": {"anyOf": [_PLACE, _PLACE_LIST]}},
                "inputs": _NAMES,
                "outputs": _NAMES,
            },
            "required": ["model", "transitions", "places", "steps"],
            "additionalProperties": False,
        },
    ],
}
