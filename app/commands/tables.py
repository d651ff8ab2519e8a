"""Results on the terminal: small tables with units, or JSON for programs."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from app.result_values import advice_by_name, by_name, price_by_name
from pricing_core.american import ExerciseAdvice, ExerciseBoundary, Greeks, ImpliedVolatility, Valuation
from pricing_core.american.contracts.result_fields import (
    ADVICE_FIELDS,
    BOUNDARY_ERROR_FIELD,
    BOUNDARY_FIELDS,
    IMPLIED_VOLATILITY_FIELDS,
    ResultField,
    price_fields,
)

if TYPE_CHECKING:
    from pricing_core.batch import BatchSummary

# Largest width of a table, in characters: a terminal wraps a long path by itself, nothing is cut.
WIDEST = 1_000


def print_valuation(valuation: Valuation, greeks: Greeks, *, greek_errors: bool) -> None:
    """Print one result per line with its unit; a missing number as a dash, a missing list or extended Greek not.

    Errors of the exercise boundary and of Greeks are a column of their own.
    """
    shown = [
        field
        for field in price_fields(greeks)
        if getattr(valuation, field.name) is not None or (field.kind != "list" and field.given != "extended")
    ]
    errors = None
    if greek_errors:
        errors = {BOUNDARY_ERROR_FIELD.of: valuation.boundary_error, **valuation.greek_errors}
    _print_results(shown, valuation, errors)


def valuation_json(valuation: Valuation, *, greek_errors: bool) -> str:
    """Return one JSON object, null for a missing number."""
    return json.dumps(price_by_name(valuation, greek_errors=greek_errors), allow_nan=False)


def print_implied_volatility(found: ImpliedVolatility) -> None:
    """Print one result per line with its unit; a missing number as a dash."""
    _print_results(IMPLIED_VOLATILITY_FIELDS, found)


def implied_volatility_json(found: ImpliedVolatility) -> str:
    """Return one JSON object, null for a missing number."""
    return _json(IMPLIED_VOLATILITY_FIELDS, found)


def print_boundary(found: ExerciseBoundary) -> None:
    """Print one time per line, a dash where there is no boundary, or no estimate of its error."""
    _print_columns(BOUNDARY_FIELDS, by_name(BOUNDARY_FIELDS, found))


def boundary_json(found: ExerciseBoundary) -> str:
    """Return one JSON object, null where there is no boundary."""
    return _json(BOUNDARY_FIELDS, found)


def print_advice(advice: ExerciseAdvice) -> None:
    """Print one result per line with its unit, then one time per line."""
    outputs = advice_by_name(advice)
    single = [field for field in ADVICE_FIELDS if field.kind != "list"]
    rows = [(field.name, _shown(outputs[field.name]), field.unit) for field in single]
    print_table(("result", "value", "unit"), rows)
    print()
    _print_columns(ADVICE_FIELDS, outputs)


def advice_json(advice: ExerciseAdvice) -> str:
    """Return one JSON object, null for a missing number."""
    return json.dumps(advice_by_name(advice), allow_nan=False)


def print_summary(
    summary: "BatchSummary", target: str, rejects: str | None, *, to_errors: bool = False
) -> None:
    """Print how many rows of a batch were priced; on standard error where output is the table."""
    rows = [("read", f"{summary.rows:,}", ""), ("priced", f"{summary.priced:,}", target)]
    if summary.below_tolerance:
        rows.append(
            ("  of them, tolerance not met", f"{summary.below_tolerance:,}", "status tolerance_not_met")
        )
    rows.append(("rejected", f"{summary.rejected:,}", (rejects or "") if summary.rejected else ""))
    if summary.unread:
        names = ", ".join(name if name.isprintable() else repr(name) for name in summary.unread)
        rows.append(("columns not read", f"{len(summary.unread):,}", names))
    print_table(("batch", "rows", "in"), rows, sys.stderr if to_errors else None)


def _json(outputs: Iterable[ResultField], found: object) -> str:
    return json.dumps(by_name(outputs, found), allow_nan=False)


def _print_columns(outputs: Iterable[ResultField], values: Mapping[str, Any]) -> None:
    """Print the lists among outputs as columns, without those that are missing."""
    lists = [field for field in outputs if field.kind == "list" and values[field.name] is not None]
    headings = (f"{field.name} ({field.unit})" if field.unit else field.name for field in lists)
    rows = zip(*(values[field.name] for field in lists), strict=True)
    print_table(headings, (tuple(map(_shown, row)) for row in rows))


def _print_results(
    outputs: Sequence[ResultField], found: object, errors: Mapping[str, object] | None = None
) -> None:
    columns = {
        "result": [field.name for field in outputs],
        "value": [_shown(getattr(found, field.name)) for field in outputs],
    }
    if errors is not None:
        columns["error"] = [
            _shown(errors.get(field.name)) if field.is_greek or field.name in errors else ""
            for field in outputs
        ]
    columns["unit"] = [field.unit for field in outputs]
    print_table(columns, zip(*columns.values(), strict=True))


def _shown(value: object) -> str:
    if value is None or value == "":
        return "-"
    if isinstance(value, tuple):
        return ", ".join(_shown(number) for number in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def print_table(names: Iterable[str], rows: Iterable[Iterable[str]], file: TextIO | None = None) -> None:
    """Print rows of texts under their headings, in columns; on standard output unless a file is given."""
    table = Table(*names, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))
    console = Console(highlight=False, width=WIDEST)
    with console.capture() as text:
        console.print(table)
    print(
        text.get(), end="", flush=True, file=file
    )  # rich itself would meet a closed pipe with an exit of its own
