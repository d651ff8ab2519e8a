"""The tables that an input names: one file, or the Parquet files of a folder with the values in their paths."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from pricing_core.american.contracts.fields import COLUMN_FIELDS
from pricing_core.batch.formats import FileFormat, format_of
from pricing_core.batch.locations import file_system, is_remote
from pricing_core.errors import InvalidInputError, Told
from pricing_core.plain_number import read_number

NULL_PARTITION = "__HIVE_DEFAULT_PARTITION__"
PARQUET = FileFormat("parquet")
MOST_COLUMNS = 2_000  # of a table; a contract has twenty, and each column costs time in every block
KINDS = {column.name: column.kind for column in COLUMN_FIELDS}


@dataclass(frozen=True, slots=True)
class TableFile:
    """One file of contracts.

    Parameters
    ----------
    location : str
        A path or a URL.
    name : str
        What messages call it; in a folder its path from there.
    format : FileFormat
    partition : tuple of (str, str, float or None)
        Columns whose one value stands in the path, as "desk=rates/".
    """

    location: str
    name: str
    format: FileFormat
    partition: tuple[tuple[str, str | float | None], ...] = ()


def is_folder(location: str) -> bool:
    """Tell a folder from a file."""
    if not is_remote(location):
        return Path(location).is_dir()
    system, path = file_system(location)
    return bool(system.isdir(path))


def tables_of(location: str, stated: str | None = None) -> tuple[TableFile, ...]:
    """Return the tables of an input, those of a folder by their names.

    Raises
    ------
    InvalidInputError
        Another ending, not a regular file, or a folder with anything else than Parquet files.
    OSError
        The input cannot be read.
    """
    if is_folder(location):
        return _tables_in(location)
    name = location.rsplit("/", 1)[-1]
    if not is_remote(location) and not stat.S_ISREG(Path(location).stat().st_mode):
        raise InvalidInputError("input", name, "a regular file, or a folder")  # others cannot be read twice
    return (TableFile(location, name, format_of("input", location, stated)),)


def check_width(columns: int) -> None:
    """Accept the number of columns of a table.

    Raises
    ------
    InvalidInputError
        There are more than 2,000.
    """
    if columns > MOST_COLUMNS:
        raise InvalidInputError(
            "input", Told(f"{columns} columns"), f"a table of at most {MOST_COLUMNS} columns"
        )


def _tables_in(location: str) -> tuple[TableFile, ...]:
    found = []
    for name in sorted(_names_in(location)):
        parts = PurePosixPath(name).parts
        if any(part.startswith(("_", ".")) for part in parts):  # _SUCCESS, _metadata, .crc
            continue
        if not name.lower().endswith(".parquet"):
            raise InvalidInputError("input", name, "left out: the files of a folder must be .parquet files")
        partition = tuple(_partition_value(part) for part in parts[:-1] if "=" in part)
        found.append(TableFile(f"{location.rstrip('/')}/{name}", name, PARQUET, partition))
    if not found:
        raise InvalidInputError(
            "input", location.rstrip("/").rsplit("/", 1)[-1], "a folder that holds .parquet files"
        )
    return tuple(found)


def _names_in(location: str) -> Iterator[str]:
    if is_remote(location):
        system, path = file_system(location)
        start = path.rstrip("/") + "/"
        yield from (str(name)[str(name).index(start) + len(start) :] for name in system.find(path))
        return
    folder = Path(location)
    yield from (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _partition_value(part: str) -> tuple[str, str | float | None]:
    name, text = (unquote(piece) for piece in part.split("=", 1))
    if text == NULL_PARTITION:
        return name, None
    if KINDS.get(name) in ("number", "curve", "time"):
        try:
            return name, read_number(name, text)
        except InvalidInputError:
            if KINDS[name] == "number":
                raise
    return name, text
