"""Results of the library as JSON has them."""

import math
from collections.abc import Iterable
from typing import Any

from pricing_core.american import Valuation
from pricing_core.american.contracts.result_fields import GREEK_ERROR_FIELDS, PRICE_FIELDS, ResultField


def by_name(outputs: Iterable[ResultField], found: object) -> dict[str, Any]:
    """Return outputs of a result by name: arrays and tuples as lists, None in the place of a NaN in a list.

    A number that is not finite stays, for the answer to refuse.
    """
    return {output.name: _plain(output, getattr(found, output.name)) for output in outputs}


def price_by_name(valuation: Valuation, *, greek_errors: bool) -> dict[str, Any]:
    """Return all outputs of a price by name, the errors of Greeks where they are wanted."""
    found = by_name(PRICE_FIELDS, valuation)
    if greek_errors:
        errors = valuation.greek_errors
        found |= {field.name: _plain(field, errors.get(field.of)) for field in GREEK_ERROR_FIELDS}
    return found


def _plain(output: ResultField, value: Any) -> Any:
    if output.kind != "list" or value is None:
        return value
    return [None if math.isnan(number) else float(number) for number in value]
