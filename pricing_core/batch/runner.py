"""A table of contracts priced chunk by chunk, with its rejects; the file is never held as a whole."""

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from pricing_core.american.arrow.schema import check_results, result_schema, unread_columns
from pricing_core.american.contracts.fields import (
    COLUMN_FIELDS,
    DEFAULT_TOLERANCE,
    Greeks,
)
from pricing_core.american.contracts.vocabulary import DATES
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.reader import TableReader, open_table
from pricing_core.batch.results import Reasons, price_chunk
from pricing_core.batch.settings import PricingSettings
from pricing_core.batch.writer import RejectsWriter, check_ending, table_writer
from pricing_core.errors import InvalidInputError
from pricing_core.replacement import replacement

ROWS_PER_CHUNK = 1024


@dataclass(frozen=True, slots=True)
class BatchSummary:
    """What became of the rows: rows = priced + rejected.

    Parameters
    ----------
    below_tolerance : int
        Priced rows whose error estimate is wider than asked for.
    unread : tuple of str
        Columns that passed through without being read, in their order: a misspelling shows here.
    """

    rows: int = 0
    priced: int = 0
    rejected: int = 0
    below_tolerance: int = 0
    unread: tuple[str, ...] = ()

    def plus(self, results: pa.RecordBatch, rejected: int) -> "BatchSummary":
        """Return the summary with one more chunk counted in."""
        statuses = results.column("status").to_pylist()
        return replace(
            self,
            rows=self.rows + len(statuses),
            priced=self.priced + len(statuses) - rejected,
            rejected=self.rejected + rejected,
            below_tolerance=self.below_tolerance + statuses.count("tolerance_not_met"),
        )


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run has come: the counters so far and the fraction of the input read, 0 to 1."""

    summary: BatchSummary
    fraction_read: float


def run_batch(
    source: Path,
    target: Path,
    *,
    rejects: Path | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    threads: int | None = None,
    chunk_rows: int = ROWS_PER_CHUNK,
    progress: Callable[[Progress], None] | None = None,
) -> BatchSummary:
    """Price every row of `source` into `target`: same rows, same order, the results appended as columns.

    A row that cannot be priced keeps its place, with a status and empty numbers, and is explained in
    `rejects`. Both files appear under their names complete or not at all.

    Parameters
    ----------
    source, target : Path
        Files ending in .csv or .parquet.
    rejects : Path, optional
        CSV with line, field, value, reason; beside `target` as NAME.rejects.csv unless stated. It is written
        even when it holds no row, so that the one of an earlier run does not stay.
    tolerance : float
        Fraction of the strike, for rows that state none.
    greeks : {"none", "standard", "extended"}
        Which Greeks are columns of the output, as in `price_many`.
    greek_errors : bool
        Whether their estimated errors are columns too.
    threads : int, optional
        Passed to `price_many`.
    progress : callable, optional
        Called after every chunk.

    Raises
    ------
    InvalidInputError
        The tolerance or greeks is not what it must be, the table as a whole cannot be read, or two of the files are
        the same.
    OSError
        A file cannot be read or written.
    """
    rejects = rejects_path(target) if rejects is None else rejects
    settings = PricingSettings(tolerance, greeks, greek_errors)
    check_ending(target)
    _check_distinct(source, target, rejects)
    with ExitStack() as stack:
        reader = stack.enter_context(open_table(source))
        added = result_schema(reader.schema.names, greeks, greek_errors=greek_errors)
        check_results(reader.schema.names, added.names)
        summary = BatchSummary(unread=unread_columns(reader.schema.names))
        # Entered first, renamed last: where the output is, its rejects are.
        output = stack.enter_context(replacement(target))
        explained = stack.enter_context(replacement(rejects))
        numbers = numbers_as_text(reader) if target.suffix.lower() == ".parquet" else ()
        columns = pa.schema([*typed_schema(reader.schema, numbers), *added])
        rows = stack.enter_context(table_writer(target, output, columns))
        faults = stack.enter_context(RejectsWriter(explained))
        for chunk in reader.chunks(chunk_rows):
            priced, reasons = price_chunk(chunk, settings, numbers, threads)
            rows.write(priced)
            _write_rejects(faults, chunk, reasons)
            summary = summary.plus(priced, len(reasons))
            if progress is not None:
                progress(Progress(summary, reader.fraction_read))
    return summary


def rejects_path(target: Path) -> Path:
    """Return where the rejects go unless it is stated: beside the output.

    Examples
    --------
    >>> rejects_path(Path("priced.parquet")).name
    'priced.rejects.csv'
    """
    return target.with_name(f"{target.stem}.rejects.csv")


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


def _write_rejects(faults: RejectsWriter, chunk: Chunk, reasons: Reasons) -> None:
    for index, fault in sorted(reasons.items()):
        # As it stands in the file, not as it was read; a fault of the whole row names no field.
        cell = chunk.cell(index, fault.field) if fault.field else None
        value = _value_in_words(fault) if cell is None else cell
        faults.reject(chunk.lines[index], fault.field, value, f"must be {fault.allowed}")


def _value_in_words(fault: InvalidInputError) -> str:
    """Return a value that is no cell: a whole line as it is, a text inside a list in quotes, as a text."""
    is_text = isinstance(fault.value, str) and fault.field
    return repr(fault.value) if is_text else str(fault.value)


def _check_distinct(source: Path, target: Path, rejects: Path) -> None:
    seen: dict[Path, str] = {}
    for name, path in {"input": source, "output": target, "rejects": rejects}.items():
        other = seen.setdefault(Path(os.path.realpath(path)), name)
        if other != name:
            raise InvalidInputError(name, str(path), f"another file than the {other}")
