"""Results of the library as JSON has them, and the models of the answers that hold them."""

import math
from collections.abc import Iterable
from typing import Any

import pydantic

from app.contract_schema import Strict
from pricing_core.american.contracts.result_fields import ResultField

# By the kind of an output: its type in an answer, None where it is missing.
TYPES: dict[str, Any] = {
    "number": float | None,
    "count": int,
    "flag": bool | None,
    "text": str,
    "list": list[float | None] | None,
}


def answer_model(name: str, meaning: str, outputs: Iterable[ResultField]) -> type[Strict]:
    """Return the model of an answer that holds these outputs."""
    definitions: dict[str, Any] = {output.name: (TYPES[output.kind], _stated(output)) for output in outputs}
    return pydantic.create_model(name, __base__=Strict, __doc__=meaning, **definitions)


def _stated(output: ResultField) -> Any:
    missing = " Null where it is missing." if output.kind in ("number", "list") else ""
    return pydantic.Field(description=output.description + missing, examples=[output.example])


def by_name(outputs: Iterable[ResultField], found: object) -> dict[str, Any]:
    """Return outputs of a result by name: arrays and tuples as lists, None in the place of a NaN in a list.

    A number that is not finite stays, for the answer to refuse.
    """
    return {output.name: _plain(output, getattr(found, output.name)) for output in outputs}


def _plain(output: ResultField, value: Any) -> Any:
    if output.kind != "list" or value is None:
        return value
    return [None if math.isnan(number) else float(number) for number in value]
