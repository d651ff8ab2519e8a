"""Tables of contracts read from files part by part, and tables of results written likewise, complete or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.assembling import check_publishable, publish_file
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contents import Contents
from pricing_core.batch.csv_lines import check_text_form, csv_lines
from pricing_core.batch.formats import FileFormat, format_of
from pricing_core.batch.locations import is_remote, same_place
from pricing_core.batch.plan import numbers_as_text
from pricing_core.batch.reader import check_table, check_unchanged, open_table, unusual_columns_of
from pricing_core.batch.tables import TableFile, tables_of
from pricing_core.batch.writer import table_writer
from pricing_core.errors import InvalidInputError
from pricing_core.replacement import replacement

Write = Callable[[pa.RecordBatch], None]


@dataclass(frozen=True, slots=True)
class InputTable:
    """One table, held by one file or by the files of a folder.

    Parameters
    ----------
    location : str
    stated : str or None
        As `input_table` was given them.
    checks : mapping of TableFile to Contents
        What a pass through each file has found.
    schema : pyarrow.Schema
        The columns of all files, those of their partitions included.
    numbers : tuple of str
        Columns of text that hold numbers alone.
    unusual : tuple of str
        What is to be warned of.
    """

    location: str
    stated: str | None
    checks: Mapping[TableFile, Contents]
    schema: pa.Schema
    numbers: tuple[str, ...]
    unusual: tuple[str, ...]

    def chunks(self) -> Iterator[Chunk]:
        """Yield all rows in order."""
        for file, check in self.checks.items():
            with open_table(file, check) as reader:
                for block in reader.blocks():
                    yield block.read()

    def check_unchanged(self) -> None:
        """Accept that the input still is what the rows were read from.

        Raises
        ------
        InvalidInputError
            It has changed.
        OSError
            It cannot be read any more.
        """
        check_unchanged(self.location, self.stated, self.checks)


def input_table(location: str, settings: PricingSettings, stated: str | None = None) -> InputTable:
    """Find the files of an input, and check their columns.

    Raises
    ------
    InvalidInputError
        It cannot be read as a table of contracts, or the files of a folder have different columns.
    OSError
        It cannot be read.
    """
    checks: dict[TableFile, Contents] = {}
    found: list[tuple[pa.Schema, tuple[str, ...]]] = []
    unusual: dict[str, None] = {}
    for file in tables_of(location, stated):
        checks[file] = check_table(file)
        with open_table(file, checks[file]) as reader:
            schema = reader.schema.remove_metadata()
            for name, value in file.partition:
                schema = schema.append(
                    pa.field(name, pa.float64() if isinstance(value, float) else pa.string())
                )
            found.append((schema, numbers_as_text(reader)))
            unusual.update(dict.fromkeys(unusual_columns_of(reader, settings)))
        if not schema.equals(found[0][0]):
            raise InvalidInputError(
                "input", file.name, f"a table with the columns of {next(iter(checks)).name}"
            )
    return InputTable(location, stated, checks, *found[0], tuple(unusual))


def check_distinct(names: dict[str, str]) -> None:
    """Accept the places of files by their roles, the output the last.

    Raises
    ------
    InvalidInputError
        The output is one of the others.
    """
    *inputs, (role, output) = names.items()
    for other, location in inputs:
        if same_place(location) == same_place(output):
            raise InvalidInputError(role, output, f"another file than the {other}")


@contextmanager
def written_table(location: str, stated: str | None, schema: pa.Schema) -> Iterator[Write]:
    """Yield what appends rows to a table that appears under its name once the block has ended without an exception.

    Raises
    ------
    InvalidInputError
        The name has another ending, or CSV cannot hold a column.
    OSError
        It cannot be written.
    """
    format_ = output_format(location, stated, schema)
    if not is_remote(location):
        with replacement(Path(location)) as file, table_writer(file, format_, schema) as writer:
            yield _writing(writer.write, format_)
        return
    with tempfile.TemporaryDirectory(prefix="pricing-") as folder:
        path = Path(folder) / "output"
        with path.open("wb") as file, table_writer(file, format_, schema) as writer:
            yield _writing(writer.write, format_)
        publish_file(path, location)


def output_format(location: str, stated: str | None, schema: pa.Schema) -> FileFormat:
    """Return the format of an output of these columns, after a look at whether it can be written there.

    Raises
    ------
    InvalidInputError
        The name has another ending, or CSV cannot hold a column.
    OSError
        It cannot be written there.
    """
    format_ = format_of("output", location, stated)
    if format_.kind == "csv":
        check_text_form(schema)
    check_publishable(location, folder=False)
    return format_


def typed_schema_of(table: InputTable, kept_as_text: bool) -> tuple[pa.Schema, Sequence[str]]:
    """Return the columns as they pass through, and those that become numbers on the way to a Parquet file."""
    if kept_as_text:
        return table.schema, ()
    fields = [pa.field(f.name, pa.float64()) if f.name in table.numbers else f for f in table.schema]
    return pa.schema(fields), table.numbers


def _writing(write: Callable[..., None], format_: FileFormat) -> Write:
    if format_.kind == "parquet":
        return write
    return lambda batch: write(csv_lines(batch))
