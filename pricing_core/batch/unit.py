"""The unit of work: some rows read, priced, and kept in a part that is there whole or not at all."""

from __future__ import annotations

import json
import zlib
from collections import Counter
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_lines import csv_lines
from pricing_core.batch.reader import Block
from pricing_core.batch.results import Reasons, price_chunk
from pricing_core.batch.work_folder import WorkFolder
from pricing_core.errors import SHOWN_CHARACTERS, DamagedPartError, InvalidInputError

COUNTS, REJECTS = b"counts", b"rejects"
REJECT_COLUMNS = ("line", "field", "value", "reason")
TEXT = "text"
CHECK_BYTES = 4  # at the end of a part, of all before them


@dataclass(frozen=True, slots=True)
class UnitRules:
    """The settings that hold for all units of a table.

    Parameters
    ----------
    settings : PricingSettings
    as_text : bool
        Whether the output is CSV: then the part holds its lines, else the rows.
    numbers : tuple of str
        Columns of text that are to become numbers.
    left_out : tuple of str
        Columns that are priced with, but not written.
    file : str or None
        What the rejects of a folder of tables call the table.
    """

    settings: PricingSettings
    as_text: bool = False
    numbers: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    file: str | None = None


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of work: consecutive rows that are to be priced; picklable.

    Parameters
    ----------
    index : int
        Its place among all units, from 0.
    part : str
        The name of its part.
    """

    index: int
    part: str
    block: Block
    rules: UnitRules


@dataclass(frozen=True, slots=True)
class Counts:
    """How many rows there were, how many have no price, and how many have each status."""

    rows: int = 0
    rejected: int = 0
    statuses: Counter[str] = field(default_factory=Counter)

    def plus(self, other: Counts) -> Counts:
        """Return the sums of both counts."""
        return Counts(self.rows + other.rows, self.rejected + other.rejected, self.statuses + other.statuses)

    def as_json(self) -> dict[str, Any]:
        """Return the counts by name, as JSON holds them."""
        return {"rows": self.rows, "rejected": self.rejected, "statuses": dict(self.statuses)}

    @classmethod
    def of_json(cls, values: dict[str, Any]) -> Counts:
        """Return the counts that `as_json` gave."""
        return cls(values["rows"], values["rejected"], Counter(values["statuses"]))


def sum_of(all_counts: Iterable[Counts]) -> Counts:
    """Return the sum of several counts."""
    return reduce(Counts.plus, all_counts, Counts())


@dataclass(frozen=True, slots=True)
class Part:
    """The priced rows and the counts of a unit, as they are kept.

    Parameters
    ----------
    counts : Counts
    rejects : bytes
        Lines of CSV, without a header.
    content : pyarrow.RecordBatch or pyarrow.Buffer
        The rows with their results, or the same as lines of CSV.
    """

    counts: Counts
    rejects: bytes
    content: Any


def price_unit(
    unit: Unit, folder: WorkFolder, turn: AbstractContextManager[object] | None = None
) -> tuple[int, Counts]:
    """Price a unit, keep its part in the folder, and return its index and the counts of its rows.

    Parameters
    ----------
    turn : context manager, optional
        Held while the unit is priced, but not while its part is written.
    """
    with turn or nullcontext():
        chunk = unit.block.read()
        rules = unit.rules
        priced, reasons = price_chunk(chunk, rules.settings, rules.numbers, 1)
        counts = Counts(priced.num_rows, len(reasons), Counter(_counted(priced.column("status"))))
        if rules.left_out:
            priced = priced.select([name for name in priced.schema.names if name not in rules.left_out])
        content = csv_lines(priced) if rules.as_text else priced
        part = Part(counts, reject_lines(chunk, reasons, rules.file), content)
        buffer = _as_buffer(part)
    folder.write(unit.part, buffer)
    return unit.index, counts


def read_part(folder: WorkFolder, name: str) -> Part:
    """Return a part that `price_unit` has kept.

    Raises
    ------
    DamagedPartError
        It is not what was written.
    """
    kept = folder.read(name)
    length = max(kept.size - CHECK_BYTES, 0)
    content = kept.slice(0, length)
    if _check_of(content) != kept.slice(length).to_pybytes():
        raise DamagedPartError(f"{name} in {folder} is damaged: --resume prices it again")
    with pa.ipc.open_stream(content) as stream:
        batch = stream.read_next_batch()
        metadata = stream.schema.metadata
    content = batch if batch.schema.names != [TEXT] else batch.column(0).buffers()[2]
    counts = Counts.of_json(json.loads(metadata[COUNTS]))
    return Part(counts, metadata[REJECTS], content)


def reject_lines(chunk: Chunk, reasons: Reasons, file: str | None = None) -> bytes:
    """Return a line of CSV for each row without a price: where it stands, field, value (40 characters), reason."""
    rows = []
    for index, fault in sorted(reasons.items()):
        # As it stands in the file, not as it was read; a fault of the whole row names no field.
        cell = chunk.cell(index, fault.field) if fault.field else None
        value = _value_in_words(fault) if cell is None else cell
        shown = value if len(value) <= SHOWN_CHARACTERS else value[: SHOWN_CHARACTERS - 3] + "..."
        place = () if file is None else (file,)
        rows.append((*place, str(chunk.lines[index]), fault.field, shown, f"must be {fault.allowed}"))
    if not rows:
        return b""
    columns = [pa.array(column, pa.string()) for column in zip(*rows, strict=True)]
    return bytes(csv_lines(pa.RecordBatch.from_arrays(columns, [str(k) for k in range(len(columns))])))


def _value_in_words(fault: InvalidInputError) -> str:
    """Return a value that is no cell: a whole line as it is, a text inside a list in quotes, as a text."""
    is_text = isinstance(fault.value, str) and fault.field
    return repr(fault.value) if is_text else str(fault.value)


def _counted(statuses: pa.Array) -> dict[str, int]:
    return {str(found["values"]): found["counts"] for found in pc.value_counts(statuses).to_pylist()}


def _as_buffer(part: Part) -> pa.Buffer:
    batch = part.content
    if isinstance(batch, pa.Buffer):
        ends = pa.py_buffer(pa.array([0, batch.size], pa.int64()).buffers()[1])
        text = pa.LargeBinaryArray.from_buffers(pa.large_binary(), 1, [None, ends, batch])
        batch = pa.RecordBatch.from_arrays([text], [TEXT])
    metadata = {COUNTS: json.dumps(part.counts.as_json()), REJECTS: part.rejects}
    batch = batch.replace_schema_metadata(metadata)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    content = sink.getvalue()
    return pa.py_buffer(b"".join((content, _check_of(content))))


def _check_of(content: pa.Buffer) -> bytes:
    return zlib.crc32(content).to_bytes(CHECK_BYTES, "little")
