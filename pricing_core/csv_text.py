"""CSV as this project writes it: UTF-8, line feeds, shortest round-trip numbers, empty cells where there is none."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import BinaryIO, Self


class CsvText:
    r"""Writes rows of texts under a header; leaving the `with` block leaves the file itself open.

    Examples
    --------
    >>> file = io.BytesIO()
    >>> with CsvText(file, ["spot", "price"]) as table:
    ...     table.write([["90.0", number_text(10.5)], ["110.0", number_text(None)]])
    >>> file.getvalue()
    b'spot,price\n90.0,10.5\n110.0,\n'
    """

    def __init__(self, file: BinaryIO, names: Iterable[str]) -> None:
        self._text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        # The csv module quotes the characters of its line terminator: with "\n" alone, a carriage return in a
        # cell would stand bare and break the row in two for whoever reads it.
        self._rows = csv.writer(_UnixLines(self._text), lineterminator="\r\n")
        self._rows.writerow(names)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._text.detach()

    def write(self, rows: Iterable[Sequence[str]]) -> None:
        """Append rows of texts."""
        self._rows.writerows(rows)


def number_text(number: float | None) -> str:
    """Return the number's shortest text that reads back the same; nothing for None or NaN."""
    return "" if number is None or math.isnan(number) else repr(number)


class _UnixLines:
    """Passes on each row, which the csv module writes in one piece, with a bare line feed as its end."""

    def __init__(self, text: io.TextIOWrapper) -> None:
        self._text = text

    def write(self, row: str) -> None:
        self._text.write(row.removesuffix("\r\n") + "\n")
