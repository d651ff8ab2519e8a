"""How a command fails: one line on standard error and a status, never a traceback."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

SOME_REJECTED = 1
FAILED = 2
INTERRUPTED = 130  # 128 + SIGINT, as shells have it


def print_failure(sentence: str) -> None:
    """Print one line on standard error, whatever the sentence holds."""
    line = " ".join(sentence.split())
    print(f"pricing: {line}", file=sys.stderr)


@contextmanager
def interrupted_by_sigterm() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, so that half-written files are removed then too."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn what a command may raise into one line and a status."""
    try:
        yield
    except KeyboardInterrupt:
        print_failure("interrupted; nothing was written")
        raise typer.Exit(INTERRUPTED) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print_failure(f"{where}{error.strerror or error}")
        raise typer.Exit(FAILED) from None
    except (ValueError, ArithmeticError) as error:  # bad input, an answer out of reach, a bad setting
        print_failure(str(error))
        raise typer.Exit(FAILED) from None
