"""One JSON object per log line, on standard error, which a reader that stands still does not hold up."""

import contextlib
import json
import logging
import os
import queue
import select
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any

MOST_LINES = 10_000  # that wait to be written; those beyond are counted and left out; chosen
FLUSH_SECONDS = 1.0  # for what waits when the process ends; chosen
# In which lines are gathered and then written together: a thread that wakes for every one takes the interpreter from
# the requests; chosen.
GATHER_SECONDS = 0.02
# Bytes that the system writes to a pipe without another process's bytes between them: at least 512 by POSIX.
WHOLE = select.PIPE_BUF
SHORTEST_PART = 100  # characters of a text that is not cut any further; chosen


class JsonFormatter(logging.Formatter):
    """Time, level, logger and message, and what the call gave as extra={"fields": {...}}.

    No line is longer than what is written to a pipe as a whole: a longer text, such as a traceback, is cut into parts,
    and each has a line with all the rest.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return one line, or several."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname,
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return "\n".join(_lines(line))


def _lines(line: dict[str, Any]) -> list[str]:
    """Return the object as JSON in lines that are short enough, which differ in parts of its longest text alone."""
    text = json.dumps(line)
    if len(text) < WHOLE:
        return [text]
    texts = {name: value for name, value in line.items() if isinstance(value, str)}
    name, longest = max(texts.items(), key=lambda item: len(item[1]))
    if len(longest) <= SHORTEST_PART:
        return [text]
    half = len(longest) // 2
    return [*_lines(line | {name: longest[:half]}), *_lines(line | {name: longest[half:]})]


def _wholes(lines: Iterable[str]) -> Iterator[bytes]:
    """Yield the lines with their ends, as many together as are written as a whole."""
    together = b""
    for line in lines:
        written = line.encode() + b"\n"
        if together and len(together) + len(written) > WHOLE:
            yield together
            together = b""
        together += written
    yield together


class BackgroundHandler(logging.Handler):
    """Writes in a thread of its own: a pipe that nobody empties blocks that alone.

    Once it is emptied again, a line says how many were left out.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._waiting: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
        self._taken = self._written = self._left_out = 0
        threading.Thread(target=self._write_all, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record to the thread, or count it as dropped."""
        if self._taken - self._written >= MOST_LINES:
            self._left_out += 1
        else:
            self._taken += 1
            self._waiting.put(record)

    def flush(self) -> None:
        """Wait a little for what has not been written yet."""
        end = time.monotonic() + FLUSH_SECONDS
        while self._written < self._taken and time.monotonic() < end:
            time.sleep(0.005)

    def _write_all(self) -> None:
        while True:
            records = [self._waiting.get()]
            time.sleep(GATHER_SECONDS)
            records += [self._waiting.get() for _ in range(self._waiting.qsize())]
            self._write(records)
            self._written += len(records)
            if self._left_out:
                words = f"{self._left_out} lines were left out: nobody read them in time"
                self._left_out = 0
                self._write([logging.LogRecord("pricing.logs", logging.WARNING, "", 0, words, None, None)])

    def _write(self, records: list[logging.LogRecord]) -> None:
        lines = (line for record in records for line in self.format(record).split("\n"))
        with contextlib.suppress(OSError):  # the reader has gone
            for whole in _wholes(lines):
                os.write(self._descriptor, whole)


class UnblockedHandler(logging.Handler):
    """Writes at once, and leaves a line out where the pipe is full: for a process that may have no thread."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or leave it out."""
        with contextlib.suppress(OSError):  # the reader has gone
            for whole in _wholes(self.format(record).split("\n")):
                if select.select([], [self._descriptor], [], 0.0)[1]:
                    os.write(self._descriptor, whole)


def configure_logging(level: str, *, in_background: bool = True) -> None:
    """Send every logger of the process, and Python's warnings, to standard error as JSON.

    Parameters
    ----------
    in_background : bool
        Whether a thread writes, which a process that still forks must not have.
    """
    handler = (BackgroundHandler if in_background else UnblockedHandler)(sys.stderr.fileno())
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(level=level, handlers=[handler], force=True)
    logging.captureWarnings(True)
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    logging.getLogger("asyncio").setLevel(logging.WARNING)
