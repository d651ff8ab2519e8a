"""The folder of a run's parts: each file in it is complete or absent, and stays when the process ends."""

from __future__ import annotations

import fcntl
import mmap
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import get_ident
from typing import Protocol

import pyarrow as pa

from pricing_core.batch.locations import file_system, is_remote
from pricing_core.errors import InvalidInputError
from pricing_core.replacement import sync_folder

LOCK = "lock"
HALF = ".half"  # ending of files that are being written


class WorkFolder(Protocol):
    """Files by name; picklable, so that other processes may write to it."""

    def write(self, name: str, content: pa.Buffer) -> None:
        """Keep a file."""
        ...

    def read(self, name: str) -> pa.Buffer:
        """Return a file."""
        ...

    def names(self) -> set[str]:
        """Return the names of the complete files."""
        ...

    def clear(self) -> None:
        """Remove what an earlier run has left."""
        ...

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        ...


def work_folder(location: str) -> WorkFolder:
    """Return the folder at a path or a URL; it is made when it is written to."""
    return RemoteFolder(location) if is_remote(location) else LocalFolder(Path(location))


@dataclass(frozen=True, slots=True)
class LocalFolder:
    """A folder of this machine."""

    path: Path

    def write(self, name: str, content: pa.Buffer) -> None:
        """Write under a temporary name, wait until the disk has it, and rename.

        The name is this thread's own: one of a run that was given up may still write the same file.
        """
        half = self.path / f"{name}.{os.getpid()}-{get_ident()}{HALF}"
        try:
            with half.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            half.replace(self.path / name)
        except OSError:
            with suppress(OSError):
                half.unlink()
            raise
        sync_folder(self.path)

    def read(self, name: str) -> pa.Buffer:
        """Map the file into memory."""
        with (self.path / name).open("rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                return pa.py_buffer(b"")
            return pa.py_buffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))

    def names(self) -> set[str]:
        """Return the names of the complete files."""
        return {entry.name for entry in os.scandir(self.path) if not entry.name.endswith(HALF)}

    def clear(self) -> None:
        """Remove what an earlier run has left; the lock stays."""
        for entry in os.scandir(self.path):
            if entry.is_dir():
                shutil.rmtree(entry.path)
            elif entry.name != LOCK:
                with suppress(FileNotFoundError):  # a thread of a run that was given up has just renamed it
                    os.unlink(entry.path)

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.path, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class RemoteFolder:
    """A prefix of an object store, whose objects appear whole."""

    url: str

    def write(self, name: str, content: pa.Buffer) -> None:
        """Put an object."""
        system, path = file_system(f"{self.url}/{name}")
        system.pipe_file(path, content.to_pybytes())

    def read(self, name: str) -> pa.Buffer:
        """Get an object."""
        system, path = file_system(f"{self.url}/{name}")
        return pa.py_buffer(system.cat_file(path))

    def names(self) -> set[str]:
        """List the objects."""
        system, path = file_system(self.url)
        with suppress(FileNotFoundError):
            return {str(name).rsplit("/", 1)[-1] for name in system.ls(path, detail=False)}
        return set()

    def clear(self) -> None:
        """Delete the objects."""
        self.remove()

    def remove(self) -> None:
        """Delete the objects."""
        system, path = file_system(self.url)
        with suppress(FileNotFoundError):
            system.rm(path, recursive=True)


@contextmanager
def claimed(folder: WorkFolder, target: str) -> Iterator[None]:
    """Hold a folder of this machine for one run: another run on the same output is refused.

    Raises
    ------
    InvalidInputError
        Another run holds it.
    OSError
        It cannot be made or written to.
    """
    if not isinstance(folder, LocalFolder):
        yield
        return
    descriptor = _locked(folder.path, target)
    try:
        yield
    finally:
        os.close(descriptor)


def _locked(path: Path, target: str) -> int:
    while True:
        path.mkdir(exist_ok=True)
        lock = path / LOCK
        try:
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except FileNotFoundError:  # the other run has just ended
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if lock.exists() and os.path.samestat(os.fstat(descriptor), lock.stat()):
                return descriptor
        except BlockingIOError:
            os.close(descriptor)
            raise InvalidInputError("output", target, "one that no other run is writing to") from None
        os.close(descriptor)
