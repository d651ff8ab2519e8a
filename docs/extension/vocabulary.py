"""Tables of the inputs and outputs, from where the library states them."""

import math
from collections.abc import Callable
from typing import TypeAlias

from pricing_core.american.contracts.field import REQUIRED, Field
from pricing_core.american.contracts.fields import (
    CONTRACT_FIELDS,
    GREEK_ERRORS,
    GREEKS,
    GREEKS_UNITS,
    TOLERANCE,
)
from pricing_core.american.contracts.result_fields import PRICE_FIELDS

Row: TypeAlias = tuple[str, ...]
Table: TypeAlias = tuple[Row, list[Row]]  # head and rows


def inputs() -> Table:
    """Return what a contract and its market state, and how it is to be priced."""
    fields = (*CONTRACT_FIELDS, TOLERANCE, GREEKS, GREEK_ERRORS, GREEKS_UNITS)
    head = ("name", "unit", "allowed", "default", "meaning")
    return head, [(f.name, f.unit, _allowed(f), _default(f), f.meaning) for f in fields]


def outputs() -> Table:
    """Return what a price comes with."""
    head = ("name", "unit", "given with Greeks", "meaning")
    return head, [(f.name, f.unit, f.given, f.meaning) for f in PRICE_FIELDS]


def _allowed(field: Field) -> str:
    if field.choices:
        return ", ".join(field.choices)
    least, most = field.limits
    if math.isinf(least) and math.isinf(most):
        return f"at most {field.most_entries}" if field.most_entries else ""
    return f"{least:g} to {most:g}"


def _default(field: Field) -> str:
    if field.default is REQUIRED:
        return "required"
    return "" if field.default in (None, ()) else str(field.default)


TABLES: dict[str, Callable[[], Table]] = {"inputs": inputs, "outputs": outputs}
