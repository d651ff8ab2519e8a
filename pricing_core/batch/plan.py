"""The plan of a run, made before any work: its tables, their columns in and out, and the identity of the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import pyarrow as pa

from pricing_core.american.arrow.schema import check_results, result_schema, unread_columns
from pricing_core.american.contracts.fields import COLUMN_FIELDS
from pricing_core.american.contracts.vocabulary import DATES
from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.contents import Contents
from pricing_core.batch.csv_lines import check_text_form
from pricing_core.batch.formats import FileFormat, format_of
from pricing_core.batch.manifest import PART, Identity, identity_of, part_names
from pricing_core.batch.reader import (
    TableReader,
    check_table,
    check_unchanged,
    open_table,
    unusual_columns_of,
)
from pricing_core.batch.tables import PARQUET, TableFile, is_folder, tables_of
from pricing_core.batch.unit import Unit, UnitRules


@dataclass(frozen=True, slots=True)
class PlannedTable:
    """One input table and the columns that its output has.

    Parameters
    ----------
    table : TableFile
    check : Contents
        What a pass through the file has found before any work.
    rows : int
        In a CSV file at most.
    schema : pyarrow.Schema
        The columns of the output.
    rules : UnitRules
    """

    table: TableFile
    check: Contents
    rows: int
    schema: pa.Schema
    rules: UnitRules


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything that a run is to do.

    Parameters
    ----------
    source : str
    input_format : str or None
        As `run_batch` was given them.
    tables : sequence of PlannedTable
    output : FileFormat
    is_folder : bool
        Whether the output is a folder, as the input then is.
    unread : tuple of str
        Columns that pass through without being read, in their order.
    unusual : tuple of str
        What is to be warned of.
    identity : Identity
    block_size : int or None
        Size of every block, in bytes of CSV and rows of Parquet; None: as the readers choose.
    """

    source: str
    input_format: str | None
    tables: Sequence[PlannedTable]
    output: FileFormat
    is_folder: bool
    unread: tuple[str, ...]
    unusual: tuple[str, ...]
    identity: Identity
    block_size: int | None

    @property
    def rows(self) -> int:
        """How many rows there are, at most."""
        return sum(planned.rows for planned in self.tables)

    def units(self) -> Iterator[tuple[int, Unit]]:
        """Yield the number of a table and a unit of it, in order, reading the tables as it goes."""
        beginning = part_names(self.identity)
        index = 0
        for number, planned in enumerate(self.tables):
            with open_table(planned.table, planned.check) as reader:
                for block in reader.blocks(self.block_size):
                    yield number, Unit(index, f"{beginning}-{index:06d}{PART}", block, planned.rules)
                    index += 1

    def check_input(self) -> None:
        """Accept that the input still is what was priced, and what the identity names.

        Raises
        ------
        InvalidInputError
            It has changed.
        OSError
            It cannot be read any more.
        """
        checks = {planned.table: planned.check for planned in self.tables}
        check_unchanged(self.source, self.input_format, checks)


def plan_of(
    source: str,
    target: str,
    settings: PricingSettings,
    *,
    input_format: str | None = None,
    output_format: str | None = None,
    block_size: int | None = None,
) -> Plan:
    """Read the heads of the input tables and return the plan of the run.

    Raises
    ------
    InvalidInputError
        A table as a whole cannot be read or written.
    OSError
        A table cannot be read.
    """
    folder = is_folder(source)
    output = PARQUET if folder else format_of("output", target, output_format)
    tables, digests, unread, warnings = [], {}, {}, {}
    for table in tables_of(source, input_format):
        check = check_table(table)
        with open_table(table, check) as reader:
            tables.append(_planned(table, check, reader, settings, output, named=folder))
            digests[table.name if folder else ""] = check.digest
            unread.update(dict.fromkeys(unread_columns(reader.schema.names)))
            warnings.update(dict.fromkeys(unusual_columns_of(reader, settings)))
    identity = identity_of(digests, settings, str(output), block_size)
    return Plan(
        source, input_format, tables, output, folder, tuple(unread), tuple(warnings), identity, block_size
    )


def _planned(
    table: TableFile,
    check: Contents,
    reader: TableReader,
    settings: PricingSettings,
    output: FileFormat,
    *,
    named: bool,
) -> PlannedTable:
    left_out = tuple(name for name, _ in table.partition)
    names = [*reader.schema.names, *left_out]
    added = result_schema(names, settings.greeks, greek_errors=settings.greek_errors, advice=settings.advice)
    check_results(names, added.names)
    numbers = numbers_as_text(reader) if output.kind == "parquet" else ()
    schema = pa.schema([*typed_schema(reader.schema, numbers), *added])
    if output.kind == "csv":
        check_text_form(schema)
    rules = UnitRules(settings, output.kind == "csv", numbers, left_out, table.name if named else None)
    return PlannedTable(table, check, reader.rows, schema, rules)


def numbers_as_text(reader: TableReader) -> tuple[str, ...]:
    """Return the columns that hold numbers alone, and as text."""
    kinds = ["number"]
    if not reader.may_hold_curves:
        kinds.append("curve")
    if not any(name in DATES for name in reader.schema.names):
        kinds.append("time")
    names = [field.name for field in COLUMN_FIELDS if field.kind in kinds]
    return tuple(
        field.name for field in reader.schema if field.name in names and pa.types.is_string(field.type)
    )


def typed_schema(schema: pa.Schema, numbers: Sequence[str]) -> pa.Schema:
    """Return the columns of the input, some of them as numbers."""
    return pa.schema(
        [pa.field(field.name, pa.float64()) if field.name in numbers else field for field in schema]
    )
