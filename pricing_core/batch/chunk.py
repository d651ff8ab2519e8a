"""Consecutive rows of a table, as they were read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import pyarrow as pa

from pricing_core.american.arrow.cells import is_empty, python_value
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Chunk:
    """Rows with the place of each in its file.

    Parameters
    ----------
    lines : Sequence[int]
        Where each row starts: its line in a CSV file (the header is line 1), its number in a Parquet file
        (the first is 1).
    table : pa.RecordBatch
        The cells as they were read: text in a CSV file.
    malformed : Mapping[int, InvalidInputError]
        Rows that do not fit the header, by index in the chunk.
    """

    lines: Sequence[int]
    table: pa.RecordBatch
    malformed: Mapping[int, InvalidInputError] = field(default_factory=dict)

    def read(self) -> Chunk:
        """Return the chunk itself: its rows have been read already."""
        return self

    def cell(self, index: int, name: str) -> str | None:
        """Return a cell as text, "" if it is empty; None where there is no such column."""
        if name not in self.table.schema.names:
            return None
        value = python_value(self.table.column(name)[index])
        return "" if is_empty(value) else str(value)
