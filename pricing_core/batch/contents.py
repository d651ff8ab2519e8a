"""What a file held when a run began: the same bytes are read again, or the run ends."""

from __future__ import annotations

import hashlib
import io
import os
from dataclasses import dataclass
from typing import Any, BinaryIO

from pricing_core.batch.locations import file_system, is_remote, open_binary
from pricing_core.errors import InvalidInputError, shown

BLOCK = 1 << 18  # bytes that are hashed as one; 32 bytes are kept of each
BYTES_PER_READ = 1 << 20
EMPTY = hashlib.sha256().digest()


@dataclass(frozen=True, slots=True)
class Contents:
    """What a pass through a file has found.

    Parameters
    ----------
    digest : str
        SHA-256 of the file as it lies there.
    blocks : tuple of bytes
        SHA-256 of every 256 KiB of it.
    file_size : int
        Bytes.
    stamp : object
        What the file system tells of the file; where it tells the same again, the file is the same.
    """

    digest: str
    blocks: tuple[bytes, ...]
    file_size: int
    stamp: object

    def check_still_at(self, location: str, name: str) -> None:
        """Accept a file that holds the same now; it is read again only where the file system tells of a change.

        Raises
        ------
        InvalidInputError
            It has changed, or is gone.
        """
        stamp = stamp_of(location)
        if stamp is None or (stamp != self.stamp and contents_of(location).digest != self.digest):
            raise input_changed(name)


class Recorder:
    """Passes on what is read of a file, and remembers what it held.

    Parameters
    ----------
    stamp : object
        What the file system told of the file before it was opened.
    """

    closed = False

    def __init__(self, file: BinaryIO, stamp: object) -> None:
        self._file, self._stamp = file, stamp
        self._whole, self._block = hashlib.sha256(), hashlib.sha256()
        self._blocks: list[bytes] = []
        self._size = 0

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the file to the one who opened it."""

    def read(self, size: int = -1) -> bytes:
        """Read and remember."""
        content = self._file.read(size)
        self._whole.update(content)
        rest = memoryview(content)
        while rest:
            taken = rest[: BLOCK - self._size % BLOCK]
            self._block.update(taken)
            self._size += len(taken)
            rest = rest[len(taken) :]
            if self._size % BLOCK == 0:
                self._end_block()
        return content

    def readable(self) -> bool:
        """Return True, as of a file."""
        return True

    def close(self) -> None:
        """Leave the file to the one who opened it."""

    def contents(self) -> Contents:
        """Read the rest, and return what the file held."""
        while self.read(BYTES_PER_READ):
            pass
        if self._size % BLOCK:
            self._end_block()
        return Contents(self._whole.hexdigest(), tuple(self._blocks), self._size, self._stamp)

    def _end_block(self) -> None:
        self._blocks.append(self._block.digest())
        self._block = hashlib.sha256()


def contents_of(location: str) -> Contents:
    """Read a file once, and return what it held."""
    stamp = stamp_of(location)
    with open_binary(location) as file:
        return Recorder(file, stamp).contents()


def stamp_of(location: str) -> object:
    """Return what the file system tells of a file without reading it; None where there is none."""
    try:
        if not is_remote(location):
            found = os.stat(location)
            return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
        system, path = file_system(location)
        system.invalidate_cache()  # it may keep what it has told before
        return system.info(path)
    except FileNotFoundError:
        return None


def open_unchanged(location: str, contents: Contents, name: str) -> BinaryIO:
    """Open a file that gives the bytes that it held, and raises `InvalidInputError` where it holds others now.

    Parameters
    ----------
    name : str
        What messages call the file.
    """
    return io.BufferedReader(_Unchanged(open_binary(location), contents, name), BLOCK)


def input_changed(name: str) -> InvalidInputError:
    """Return the fault of an input that is not what it was when the run began."""
    sentence = f"the input changed while it was read: {shown(name)}; nothing was written"
    return InvalidInputError("input", name, "left as it is while it is read", sentence)


class _Unchanged(io.RawIOBase):
    """Reads whole blocks, and passes on none that is not as it was."""

    def __init__(self, file: BinaryIO, contents: Contents, name: str) -> None:
        self._file, self._contents, self._name = file, contents, name
        self._place = 0
        self._held: tuple[int, bytes] = (-1, b"")  # the block read last, and its number

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + (0, self._place, self._contents.file_size)[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def readinto(self, buffer: Any) -> int:
        number, start = divmod(self._place, BLOCK)
        if self._held[0] != number:
            self._held = number, self._block(number)
        taken = self._held[1][start : start + len(buffer)]
        buffer[: len(taken)] = taken
        self._place += len(taken)
        return len(taken)

    def close(self) -> None:
        self._file.close()
        super().close()

    def _block(self, number: int) -> bytes:
        """Return a block, which is empty behind the end of the file."""
        if self._file.tell() != number * BLOCK:
            self._file.seek(number * BLOCK)
        content = b""
        while len(content) < BLOCK and (more := self._file.read(BLOCK - len(content))):
            content += more
        known = self._contents.blocks
        if hashlib.sha256(content).digest() != (known[number] if number < len(known) else EMPTY):
            raise input_changed(self._name)
        return content
