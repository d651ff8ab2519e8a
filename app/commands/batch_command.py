"""What `pricing batch` does besides the batch itself: standard input and output, messages, and the exit status."""

import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

from app.command_failures import Tell, named_stream, print_json, standard_output
from app.commands.progress import json_progress, shown_progress
from app.commands.tables import print_summary
from app.start_up import INTERRUPTED, NOTHING_WRITTEN
from pricing_core.batch import BatchSummary, TextCheck, rejects_path, run_batch
from pricing_core.errors import InvalidInputError, MissingInputError, Told

STANDARD = "-"


def price_table_of(
    source: str,
    target: str,
    rejects: str | None,
    *,
    quiet: bool,
    log_json: bool,
    resume: bool,
    **options: Any,
) -> BatchSummary:
    """Run the batch and print its summary; a name of "-" stands for standard input or output.

    Raises
    ------
    InvalidInputError
        As `run_batch`, or a format is missing.
    """
    explained = rejects or (None if target == STANDARD else rejects_path(target))
    with (
        input_file(source, options["input_format"]) as read,
        output_file(target, options["output_format"]) as written,
    ):
        if resume and (read, written) != (source, target):
            raise InvalidInputError("resume", Told("True"), "left out where a table comes or goes by a pipe")
        with _progress(quiet=quiet, log_json=log_json) as progress:
            summary = run_batch(read, written, rejects=explained, resume=resume, progress=progress, **options)
    if log_json:
        _log_end(summary, target)
    elif not quiet:
        with suppress(typer.Exit, OSError), standard_output():  # the files are there, whoever reads this
            print_summary(summary, target, explained, to_errors=target == STANDARD)
    return summary


def end_interrupted(error: KeyboardInterrupt, tell: Tell, *, by_pipe: bool) -> None:
    """Say which parts are kept, and end without waiting for the rows that are being priced.

    Parameters
    ----------
    tell : callable
        Tells how the run ended.
    by_pipe : bool
        Whether a table came or went by a pipe: then nothing is kept.
    """
    if getattr(error, "__notes__", ()) and not by_pipe:
        again = shlex.join(["pricing", *(word for word in sys.argv[1:] if word != "--resume"), "--resume"])
        tell("error", f"interrupted; go on with: {again}")
    else:
        tell("error", NOTHING_WRITTEN)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(INTERRUPTED)


def _progress(*, quiet: bool, log_json: bool) -> Any:
    return json_progress() if log_json else shown_progress(quiet)


def _log_end(summary: BatchSummary, target: str) -> None:
    counts = {name: getattr(summary, name) for name in ("rows", "priced", "rejected", "below_tolerance")}
    print_json({"event": "end", **counts, "unread": list(summary.unread), "output": target})


def check_format(side: str, stated: str | None) -> None:
    """Accept the format of standard input or output.

    Raises
    ------
    InvalidInputError
        It is not given, or not known.
    """
    if stated is None:
        raise MissingInputError(f"{side}_format", f"standard {side} may be csv or parquet")
    if stated not in ("csv", "parquet"):
        raise InvalidInputError(f"{side}_format", stated, f'"csv" or "parquet" for standard {side}')


@contextmanager
def input_file(source: str, stated: str | None) -> Iterator[str]:
    """Yield a file; standard input is copied into one, so that it can be read twice."""
    if source != STANDARD:
        yield source
        return
    check_format("input", stated)
    with tempfile.TemporaryDirectory(prefix="pricing-") as folder:
        path = Path(folder) / f"stdin.{stated}"
        text = TextCheck(path.name)
        with path.open("wb") as file:
            while block := _standard_input():
                if stated == "csv":  # a line without end is not to fill the disk
                    text.feed(block)
                file.write(block)
        yield os.fspath(path)


def _standard_input() -> bytes:
    try:
        return sys.stdin.buffer.read(1 << 20)
    except OSError as error:
        raise named_stream(error, "standard input") from None


@contextmanager
def output_file(target: str, stated: str | None) -> Iterator[str]:
    """Yield a file; what is in it goes to standard output once it is complete."""
    if target != STANDARD:
        yield target
        return
    check_format("output", stated)
    with standard_output():
        os.write(1, b"")  # where it is closed this is said before there is any work
    with tempfile.TemporaryDirectory(prefix="pricing-") as folder:
        path = Path(folder) / f"stdout.{stated}"
        yield os.fspath(path)
        with path.open("rb") as file, standard_output():
            shutil.copyfileobj(file, sys.stdout.buffer, 1 << 20)
            sys.stdout.buffer.flush()
