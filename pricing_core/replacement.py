"""A file that appears under its name complete or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


@contextmanager
def replacement(path: Path) -> Iterator[BinaryIO]:
    """Open a new file beside `path` and rename it to `path` once the block has ended without an exception.

    On an exception, KeyboardInterrupt included, the new file is removed and what was at `path` stays. A link
    stays a link: the file it leads to is replaced. An existing file passes on its mode. A device or a pipe
    is written to directly, because it cannot be replaced.

    Raises
    ------
    OSError
        As `check_replaceable`, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "out.txt"
    >>> with replacement(target) as file:
    ...     _ = file.write(b"all of it")
    >>> target.read_text()
    'all of it'
    """
    check_replaceable(path)
    if path.exists() and not path.is_file():
        with path.open("wb") as file:
            yield file
        return
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            if target.exists():
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(target.parent)


def publish(finished: Path, target: Path) -> None:
    """Give a finished file its name, as `replacement` does; it is copied where it lies on another device.

    Raises
    ------
    OSError
        As `replacement`.
    """
    check_replaceable(target)
    place = Path(os.path.realpath(target))
    if not place.exists() or place.is_file():
        _sync(finished)
        if place.exists():
            finished.chmod(stat.S_IMODE(place.stat().st_mode))
        try:
            finished.replace(place)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
        else:
            sync_folder(place.parent)
            return
    with finished.open("rb") as source, replacement(target) as file:
        shutil.copyfileobj(source, file)
    finished.unlink()


def check_replaceable(path: Path) -> None:
    """Raise where `replacement` could not write under a name; nothing is touched.

    Raises
    ------
    OSError
        The folder is missing, `path` is a folder, or it is a file marked read-only.
    """
    if path.is_dir():
        raise _os_error(errno.EISDIR, path)
    folder = Path(os.path.realpath(path)).parent
    if not path.exists() and not folder.is_dir():
        raise _os_error(errno.ENOENT, folder)
    # The mode is looked at too: to a superuser every file is writable.
    if path.is_file() and not (path.stat().st_mode & 0o222 and os.access(path, os.W_OK)):
        raise _os_error(errno.EACCES, path)


def _os_error(number: int, path: Path) -> OSError:
    return OSError(number, os.strerror(number), str(path))


def sync_folder(folder: Path) -> None:
    """Make the renames in a folder survive a power cut."""
    with suppress(OSError):  # some file systems cannot open a folder
        _sync(folder)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
