"""The end of a command that fails: one line on standard error and an exit status, never a traceback."""

import errno
import json
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import typer

from app.start_up import INTERRUPTED, NOTHING_WRITTEN, SIGNALS, leave_signals

SOME_REJECTED = 1
FAILED = 2
NOBODY_READS = 141  # 128 + SIGPIPE


Tell = Callable[[str, str], None]  # takes the kind of an event, "error" or "warning", and a sentence


def print_failure(sentence: str) -> None:
    """Print a sentence on standard error as one line, whatever characters it holds."""
    line = " ".join(sentence.split())
    print(f"pricing: {line}", file=sys.stderr)


def print_json(line: Mapping[str, Any]) -> None:
    """Print an object as one line on standard error."""
    print(json.dumps(line), file=sys.stderr, flush=True)


def tell_in_words(event: str, sentence: str) -> None:
    """Tell of an error or a warning in a line of text."""
    print_failure(sentence if event == "error" else f"{event}: {sentence}")


def tell_in_json(event: str, sentence: str) -> None:
    """Tell of an error or a warning in a line of JSON."""
    print_json({"event": event, "message": sentence})


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Let SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt, so that half-written files are removed then too."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:  # as nohup has it
                signal.signal(number, signal.default_int_handler)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        leave_signals()  # what they would say at the start is no longer so


@contextmanager
def standard_output() -> Iterator[None]:
    """Print inside: a reader that has gone ends the command quietly, as SIGPIPE does; other errors pass.

    Raises
    ------
    typer.Exit
        Nobody reads.
    OSError
        What is printed cannot be written.
    """
    try:
        yield
        print(end="", flush=True)
    except OSError as error:
        # What is left in the buffer goes nowhere, so that the interpreter's own last flush cannot fail.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        if isinstance(error, BrokenPipeError):
            raise typer.Exit(NOBODY_READS) from None
        raise named_stream(error, "standard output") from None


def named_stream(error: OSError, stream: str) -> OSError:
    """Return the fault of a standard stream with the name of the stream, and in words where it is closed."""
    if error.filename is not None or error.errno is None:
        return error
    words = "it is closed" if error.errno == errno.EBADF else error.strerror
    return OSError(error.errno, words, stream)


def told_of(error: OSError) -> str:
    """Return what is wrong with which file in one sentence."""
    where = f"{error.filename}: " if error.filename else ""
    return "; ".join([f"{where}{error.strerror or error}", *getattr(error, "__notes__", ())])


@contextmanager
def one_line_errors(tell: Tell = tell_in_words) -> Iterator[None]:
    """Turn bad input, an answer out of reach, a bad setting or a missing extra into one line and a status."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: tell("warning", str(message))
            yield
    except KeyboardInterrupt:
        tell("error", NOTHING_WRITTEN)
        raise typer.Exit(INTERRUPTED) from None
    except OSError as error:
        tell("error", told_of(error))
        raise typer.Exit(FAILED) from None
    except (ValueError, ArithmeticError, ImportError) as error:
        tell("error", str(error))
        raise typer.Exit(FAILED) from None
