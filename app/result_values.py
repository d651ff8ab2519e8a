"""Results of the library as JSON has them."""

import math
from collections.abc import Iterable
from typing import Any

from app.greeks_units import in_units
from pricing_core.american import ExerciseAdvice, Valuation, ValueSurface
from pricing_core.american.contracts.fields import GreeksUnits
from pricing_core.american.contracts.result_fields import (
    ADVICE_FIELDS,
    BOUNDARY_ERROR_FIELD,
    GREEK_ERROR_FIELDS,
    PRICE_FIELDS,
    SURFACE_FIELDS,
    ResultField,
)
from pricing_core.kernel import instruction_set
from pricing_core.version import ENGINE_VERSION


def by_name(outputs: Iterable[ResultField], found: object) -> dict[str, Any]:
    """Return outputs of a result by name: arrays and tuples as lists, None in the place of a NaN in a list.

    A number that is not finite stays, for the answer to refuse.
    """
    return {output.name: _plain(output, getattr(found, output.name)) for output in outputs}


def provenance() -> dict[str, str]:
    """Return the versions with which an answer can be reproduced."""
    return {"engine_version": ENGINE_VERSION, "instruction_set": instruction_set()}


def surface_by_name(surface: ValueSurface, units: GreeksUnits) -> dict[str, Any]:
    """Return all outputs of a surface by name, its Greeks in the units asked for."""
    return in_units(by_name(SURFACE_FIELDS, surface), units) | provenance()


def advice_by_name(advice: ExerciseAdvice) -> dict[str, Any]:
    """Return all outputs of an advice by name; None for the expected time of what never happens."""
    never = {"expected_time": None} if math.isnan(advice.expected_time) else {}
    return by_name(ADVICE_FIELDS, advice) | never


def price_by_name(valuation: Valuation, *, greek_errors: bool) -> dict[str, Any]:
    """Return all outputs of a price by name, the errors of the boundary and of Greeks where they are wanted."""
    found = by_name(PRICE_FIELDS, valuation)
    if greek_errors:
        errors = valuation.greek_errors
        found |= by_name([BOUNDARY_ERROR_FIELD], valuation)
        found |= {field.name: _plain(field, errors.get(field.of)) for field in GREEK_ERROR_FIELDS}
    return found


def _plain(output: ResultField, value: Any) -> Any:
    if output.kind not in ("list", "matrix", "flags") or value is None:
        return value
    if output.kind == "flags":
        return value.tolist()
    if output.kind == "matrix":
        return [[None if math.isnan(number) else number for number in row] for row in value.tolist()]
    return [None if math.isnan(number) else float(number) for number in value]
