"""Answers of the service as the results of the library; all of them are checked before they are used."""

import json
import math
from collections.abc import Iterable
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from app.client.errors import BrokenAnswerError
from pricing_core.american import ExerciseAdvice, ExerciseBoundary, ImpliedVolatility, Valuation, ValueSurface
from pricing_core.american.book.valuation import Diagnostics
from pricing_core.american.contracts.result_fields import (
    ADVICE_FIELDS,
    BOUNDARY_ERROR_FIELD,
    BOUNDARY_FIELDS,
    GREEK_ERROR_FIELDS,
    IMPLIED_VOLATILITY_FIELDS,
    PRICE_FIELDS,
    SURFACE_FIELDS,
    ResultField,
)

ARRAYS = ("list", "matrix", "flags")


def valuation(response: httpx.Response) -> Valuation:
    """Return the answer of /v1/price, which was asked with greek_errors."""
    answer = _object(response)
    found = _read((*PRICE_FIELDS, BOUNDARY_ERROR_FIELD), answer)
    errors = {field.of: error for field, error in zip(GREEK_ERROR_FIELDS, _values(answer), strict=True)}
    known = {name: error for name, error in errors.items() if error is not None}
    return Valuation(**found, greek_errors=known, diagnostics=Diagnostics())


def implied_volatility(response: httpx.Response) -> ImpliedVolatility:
    """Return the answer of /v1/implied-volatility."""
    return ImpliedVolatility(**_read(IMPLIED_VOLATILITY_FIELDS, _object(response)))


def exercise_boundary(response: httpx.Response) -> ExerciseBoundary:
    """Return the answer of /v1/boundary."""
    return ExerciseBoundary(**_as_arrays(BOUNDARY_FIELDS, _object(response)))


def exercise_advice(response: httpx.Response) -> ExerciseAdvice:
    """Return the answer of /v1/exercise-advice."""
    found = _as_arrays(ADVICE_FIELDS, _object(response))
    expected = found.pop("expected_time")
    return ExerciseAdvice(**found, expected_time=math.nan if expected is None else expected)


def value_surface(response: httpx.Response) -> ValueSurface:
    """Return the answer of /v1/surface."""
    return ValueSurface(**_as_arrays(SURFACE_FIELDS, _object(response)))


def results_table(response: httpx.Response, count: int) -> pa.Table:
    """Return the answer of /v1/batch to `rows` rows, as an Arrow table.

    Raises
    ------
    BrokenAnswerError
        It is no Arrow stream, or of another number of rows.
    """
    try:
        with pa.ipc.open_stream(response.content) as stream:
            table = stream.read_all()
    except (pa.ArrowException, OSError) as error:
        raise BrokenAnswerError(f"the answer is not one Arrow stream: {error}") from None
    if table.num_rows != count or "status" not in table.schema.names:
        raise BrokenAnswerError(f"the answer has {table.num_rows} rows, and {count} were asked for")
    return table


def as_columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    """Return a table of results as `price_many` does: missing numbers NaN, a tuple per row for lists."""
    return {name: _column(table.column(name)) for name in table.schema.names}


def _column(column: pa.ChunkedArray) -> NDArray[Any]:
    kind = column.type
    if pa.types.is_list(kind):
        tuples = np.empty(len(column), dtype=object)
        tuples[:] = [tuple(entry or ()) for entry in column.to_pylist()]
        return tuples
    if pa.types.is_boolean(kind):
        return np.array([bool(flag) for flag in column.to_pylist()])
    if pa.types.is_string(kind):
        return np.array([text or "" for text in column.to_pylist()], dtype=object)
    return np.asarray(column.to_numpy(), dtype=float)


def _object(response: httpx.Response) -> dict[str, Any]:
    try:
        found = json.loads(response.content)
    except ValueError:
        raise BrokenAnswerError("the answer is not JSON") from None
    if not isinstance(found, dict):
        raise BrokenAnswerError("the answer is not a JSON object")
    return found


def _read(fields: Iterable[ResultField], answer: dict[str, Any]) -> dict[str, Any]:
    """Return the outputs of an answer, each of its own kind; lists as tuples."""
    return {field.name: _value(field, answer) for field in fields}


def _values(answer: dict[str, Any]) -> list[Any]:
    return [_value(field, answer) for field in GREEK_ERROR_FIELDS]


def _value(field: ResultField, answer: dict[str, Any]) -> Any:
    if field.name not in answer:
        raise BrokenAnswerError(f"the answer has no {field.name}")
    value = answer[field.name]
    if not _is_of(field.kind, value):
        raise BrokenAnswerError(f"{field.name} of the answer is not a {field.kind}")
    if field.kind == "number" and value is not None:
        return float(value)
    return tuple(value) if isinstance(value, list) and field.kind == "list" else value


def _is_of(kind: str, value: Any) -> bool:
    if value is None:
        return kind not in ("text", "count", "flag")
    if kind == "number":
        return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if kind in ARRAYS:
        return isinstance(value, list)
    return isinstance(value, {"text": str, "flag": bool, "count": int}[kind])


def _as_arrays(fields: Iterable[ResultField], answer: dict[str, Any]) -> dict[str, Any]:
    """Return the outputs of an answer, lists and matrices as arrays, null as NaN."""
    found = _read(fields, answer)
    for field in fields:
        if field.kind in ARRAYS and found[field.name] is not None:
            kind = bool if field.kind == "flags" else float
            try:
                found[field.name] = np.array(found[field.name], dtype=kind)
            except (TypeError, ValueError):
                raise BrokenAnswerError(f"{field.name} of the answer is not a {field.kind}") from None
    return found
