"""The formats of tables, by the endings of their names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pricing_core.errors import InvalidInputError

Kind = Literal["csv", "parquet"]
Compression = Literal["gzip", "zstd"]
COMPRESSIONS: dict[str, Compression] = {".gz": "gzip", ".zst": "zstd"}


@dataclass(frozen=True, slots=True)
class FileFormat:
    """What a file holds; only CSV is compressed as a whole."""

    kind: Kind
    compression: Compression | None = None


def format_of(role: str, name: str, stated: str | None = None) -> FileFormat:
    """Return the format that is stated, or else the one of the name's ending.

    Parameters
    ----------
    role : {"input", "output"}
        What the message calls the file.

    Raises
    ------
    InvalidInputError
        Another ending or another word.

    Examples
    --------
    >>> format_of("input", "book.CSV.gz")
    FileFormat(kind='csv', compression='gzip')
    """
    short = name.rstrip("/").rsplit("/", 1)[-1]
    lowered = short.lower()
    compression = next((COMPRESSIONS[end] for end in COMPRESSIONS if lowered.endswith(end)), None)
    if stated is not None:
        if stated == "csv":
            return FileFormat("csv", compression)
        if stated == "parquet":
            return FileFormat("parquet")
        raise InvalidInputError(f"{role}_format", stated, '"csv" or "parquet"')
    bare = lowered.rsplit(".", 1)[0] if compression else lowered
    if bare.endswith(".csv"):
        return FileFormat("csv", compression)
    if lowered.endswith(".parquet"):
        return FileFormat("parquet")
    raise InvalidInputError(role, short, "a .csv, .csv.gz, .csv.zst or .parquet file")
