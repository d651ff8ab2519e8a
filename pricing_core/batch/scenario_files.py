"""Scenarios and explanations of tables in files, a part at a time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pricing_core.american.arrow.schema import unread_columns
from pricing_core.american.book.unusual import warn_of
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.explain import Book, Explanation
from pricing_core.batch.formats import format_of
from pricing_core.batch.groups import SIZES
from pricing_core.batch.local_threads import threads_or_all
from pricing_core.batch.locations import as_location
from pricing_core.batch.scenario import Scenario, checked_scenarios
from pricing_core.batch.scenarios import Form, ScenarioRules, form_of, scenario_rows
from pricing_core.batch.table_files import (
    InputTable,
    check_distinct,
    input_table,
    typed_schema_of,
    written_table,
)
from pricing_core.batch.valued import Valued

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class ScenarioSummary:
    """The numbers of rows and contracts that a run has written.

    Parameters
    ----------
    contracts : int
        In the input, or, of an explanation, rows of the output.
    rows : int
        In the output.
    incomplete : int
        Contracts without a profit or loss in some scenario, or left out of its sums.
    unread : tuple of str
        Columns that passed through without being read, in their order: a misspelling shows here.
    """

    contracts: int
    rows: int
    incomplete: int
    unread: tuple[str, ...] = ()


def run_scenarios(
    source: PathLike,
    target: PathLike,
    scenarios: Iterable[Scenario],
    *,
    named: bool = False,
    matrix: bool = False,
    group_by: Sequence[str] = (),
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "none",
    share_solves: bool = False,
    threads: int | None = None,
    input_format: str | None = None,
    output_format: str | None = None,
) -> ScenarioSummary:
    """Value the contracts of a file under scenarios into another file, which appears complete or not at all.

    The memory needed does not grow with the number of contracts, but with that of groups.

    Parameters
    ----------
    source : str or path
        A file as `run_batch` takes it, or a folder of Parquet files with the same columns.
    target : str or path
        A file.
    scenarios : iterable of Scenario
    named : bool
        Whether the rows have the column "scenario".
    matrix, group_by, tolerance, greeks, share_solves
        As in `value_scenarios`.
    threads : int, optional
        Rows priced at a time; as many as there are processors unless stated.
    input_format, output_format : {"csv", "parquet"}, optional
        For names that end otherwise.

    Raises
    ------
    InvalidInputError
        An argument is not what it must be, the table as a whole cannot be read or written, or it changed while it was
        read.
    OSError
        A file cannot be read or written.
    """
    read, written = as_location(source), as_location(target)
    check_distinct({"input": read, "output": written})
    settings = PricingSettings(tolerance, greeks, share_solves=share_solves)
    as_text = format_of("output", written, output_format).kind == "csv"
    table = input_table(read, settings, input_format)
    warn_of(table.unusual, callers=2)
    schema, numbers = typed_schema_of(table, kept_as_text=as_text)
    rules = ScenarioRules(checked_scenarios(scenarios), settings, named, threads_or_all(threads), numbers)
    counted = _Counted(form_of(schema, rules, matrix=matrix, group_by=group_by))
    rows = 0
    with written_table(written, output_format, counted.schema) as write:
        for batch in scenario_rows(table.chunks(), rules, counted):
            write(batch)
            rows += batch.num_rows
        table.check_unchanged()
    read_by_sums = (*group_by, *(size.name for size in SIZES)) if group_by else ()
    unread = [name for name in unread_columns(table.schema.names) if name not in read_by_sums]
    return ScenarioSummary(counted.contracts, rows, counted.incomplete, tuple(unread))


def run_explain(
    before: PathLike,
    after: PathLike,
    target: PathLike,
    *,
    key: str | Sequence[str] = "id",
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
    output_format: str | None = None,
) -> ScenarioSummary:
    """Explain what contracts have gained or lost between two files into a third one; both are held in memory.

    Parameters
    ----------
    before, after : str or path
        Files as `run_scenarios` takes them.
    target : str or path
        A file, which appears complete or not at all.
    key, tolerance
        As in `explain_profit_and_loss`.
    threads, output_format
        As in `run_scenarios`.

    Raises
    ------
    InvalidInputError
        An argument is not what it must be, a table as a whole cannot be read or written, or it changed while it was
        read.
    OSError
        A file cannot be read or written.
    """
    places = [as_location(name) for name in (before, after, target)]
    check_distinct(dict(zip(("table before", "table after", "output"), places, strict=True)))
    settings = PricingSettings(tolerance)
    format_of("output", places[2], output_format)
    tables = [input_table(place, settings) for place in places[:2]]
    warn_of([sentence for table in tables for sentence in table.unusual], callers=2)
    explanation = Explanation(_book(tables[0]), _book(tables[1]), key, settings, threads_or_all(threads))
    rows = incomplete = 0
    with written_table(places[2], output_format, explanation.schema) as write:
        for batch in explanation.rows():
            write(batch)
            rows += batch.num_rows
            incomplete += batch.column("profit_and_loss").null_count
        for table in tables:
            table.check_unchanged()
    return ScenarioSummary(rows, rows, incomplete)


class _Counted:
    """A form that counts the contracts that it is given."""

    def __init__(self, form: Form) -> None:
        self._form, self.schema = form, form.schema
        self.contracts = self._without = 0

    @property
    def left_out(self) -> int:
        """How many contracts are missing in a sum."""
        return self._form.left_out

    @property
    def incomplete(self) -> int:
        """How many contracts lack a profit or loss, or are left out of a sum."""
        return max(self._without, self.left_out)

    def rows(self, valued: Valued) -> pa.RecordBatch | None:
        """Return the rows of some contracts."""
        self.contracts += valued.count
        self._without += int(np.isnan(valued.profit_and_loss()).any(axis=0).sum())
        return self._form.rows(valued)

    def last_rows(self) -> pa.RecordBatch | None:
        """Return what comes behind all contracts."""
        return self._form.last_rows()


def _book(table: InputTable) -> Book:
    batches, malformed, rows = [], {}, 0
    for chunk in table.chunks():
        malformed.update({rows + row: fault for row, fault in chunk.malformed.items()})
        batches.append(chunk.table.replace_schema_metadata(None))
        rows += chunk.table.num_rows
    if not batches:
        return Book(pa.RecordBatch.from_pylist([], table.schema))
    return Book(pa.concat_batches(batches), malformed)
