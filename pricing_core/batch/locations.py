"""Where tables lie: paths of this machine, and URLs that fsspec opens."""

from __future__ import annotations

import os
from errno import ENOENT
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote, urlsplit

from pricing_core.errors import InvalidInputError
from pricing_core.extras import needs_extra
from pricing_core.replacement import replacement


def is_remote(location: str) -> bool:
    """Tell a URL from a path of this machine.

    Examples
    --------
    >>> [is_remote(name) for name in ("s3://books/today.parquet", "file:///books/today.csv", "today.csv")]
    [True, False, False]
    """
    return "://" in location and not location.startswith("file://")


def as_location(name: str | os.PathLike[str]) -> str:
    """Return a path of this machine for a file URL; anything else as it is.

    Examples
    --------
    >>> as_location("file:///books/end%20of%20day.csv")
    '/books/end of day.csv'
    """
    text = os.fspath(name)
    return unquote(urlsplit(text).path) if text.startswith("file://") else text


def same_place(location: str) -> str:
    """Return one name for all names of a place."""
    return location.rstrip("/") if is_remote(location) else os.path.realpath(location)


def open_binary(location: str) -> BinaryIO:
    """Open a file for reading.

    Raises
    ------
    OSError
        It cannot be read.
    """
    if not is_remote(location):
        return Path(location).open("rb")
    system, path = file_system(location)
    try:
        file: BinaryIO = system.open(path, "rb")
    except FileNotFoundError as error:
        raise FileNotFoundError(ENOENT, "No such file", location) from error
    return file


def file_system(location: str) -> tuple[Any, str]:
    """Return the fsspec file system of a URL, and the path in it.

    Raises
    ------
    InvalidInputError
        No such file system is known, or what it needs is not installed.
    """
    with needs_extra("batch"):
        from fsspec.core import url_to_fs  # noqa: PLC0415
    try:
        system, path = url_to_fs(location)
    except (ValueError, ImportError) as error:
        raise InvalidInputError(
            "URL", location, f"of a file system that fsspec opens here: {error}"
        ) from None
    return system, path


def size_of(location: str) -> int | None:
    """Return the number of bytes of a file, None where there is none."""
    try:
        if not is_remote(location):
            return Path(location).stat().st_size
        system, path = file_system(location)
        return int(system.size(path))
    except OSError:
        return None


def read_bytes(location: str) -> bytes:
    """Return a file as a whole, nothing where there is none."""
    try:
        with open_binary(location) as file:
            return file.read()
    except OSError:
        return b""


def write_bytes(location: str, content: bytes) -> None:
    """Write a file as a whole, or not at all."""
    if is_remote(location):
        system, path = file_system(location)
        system.pipe_file(path, content)
        return
    with replacement(Path(location)) as file:
        file.write(content)
