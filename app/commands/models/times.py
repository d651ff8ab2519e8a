"""The keys t_span and t_eval that models share."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.commands.model_keys import (
    NUMBER,
    VECTOR,
    Key,
    first_that_fits,
    object_schema,
    read_object,
    whole_number,
)
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError

MOST_STEPS = 1_000_000


STEPS = {"steps": whole_number(1, MOST_STEPS).described("number of equal steps", required=True)}


def _read_span(field: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InvalidInputError(field, value, "a list of two numbers: start and end")
    start, end = (NUMBER.read(f"{field}[{i}]", entry) for i, entry in enumerate(value))
    return start, end


def _read_steps(field: str, value: Any) -> int:
    return int(read_object(field, value, STEPS)["steps"])


T_SPAN = Key(_read_span, {"type": "array", "items": NUMBER.schema, "minItems": 2, "maxItems": 2})
T_EVAL = Key(
    first_that_fits([(list, VECTOR.read), (dict, _read_steps)], 'a list of times, or {"steps": 100}'),
    {"anyOf": [VECTOR.schema, object_schema(STEPS)]},
)
SPAN_AND_TIMES: Mapping[str, Key] = {
    "t_span": T_SPAN.described("[start, end]", required=True),
    "t_eval": T_EVAL.described("times to report"),
}


def times_in(values: Mapping[str, Any]) -> Vector | list[float] | None:
    """Return the times to report, None where the file does not say.

    Examples
    --------
    >>> times_in({"t_span": (0.0, 1.0), "t_eval": 4})
    array([0.  , 0.25, 0.5 , 0.75, 1.  ])
    """
    wanted: int | list[float] | None = values.get("t_eval")
    if not isinstance(wanted, int):
        return wanted
    start, end = values["t_span"]
    return np.linspace(start, end, wanted + 1)
