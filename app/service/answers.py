"""The models of the answers that hold results of the library."""

from collections.abc import Iterable
from typing import Any

import pydantic

from app.service.contract_schema import Strict
from pricing_core.american.contracts.result_fields import ResultField

# By the kind of an output: its type in an answer, None where it is missing.
TYPES: dict[str, Any] = {
    "number": float | None,
    "count": int,
    "flag": bool | None,
    "text": str,
    "list": list[float | None] | None,
    "matrix": list[list[float | None]] | None,
    "flags": list[list[bool]],
}


def answer_model(
    name: str, meaning: str, outputs: Iterable[ResultField], errors: Iterable[ResultField] = ()
) -> type[Strict]:
    """Return the model of an answer that holds these outputs, and errors of Greeks where they are asked for."""
    definitions: dict[str, Any] = {output.name: (TYPES[output.kind], _stated(output)) for output in outputs}
    for error in errors:
        definitions[error.name] = TYPES[error.kind], _stated(error, " Only with greek_errors.", default=None)
    return pydantic.create_model(name, __base__=Strict, __doc__=meaning, **definitions)


def _stated(output: ResultField, words: str = "", **others: Any) -> Any:
    missing = " Null where it is missing." if output.kind in ("number", "list", "matrix") else ""
    return pydantic.Field(
        description=output.description + missing + words, examples=[output.example], **others
    )
