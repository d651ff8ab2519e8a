"""What a command does when it fails: one line on standard error and an exit status, never a traceback."""

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

SOME_REJECTED = 1
FAILED = 2
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
NOBODY_READS = 141  # 128 + SIGPIPE


def print_failure(sentence: str) -> None:
    """Print one line on standard error, whatever the sentence holds."""
    line = " ".join(sentence.split())
    print(f"pricing: {line}", file=sys.stderr)


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt, so that half-written files are removed then too."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:  # as nohup has it
                signal.signal(number, signal.default_int_handler)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
        print(end="", flush=True)  # unlike its flush(), harmless where standard output is closed
    except OSError as error:
        # What is left in the buffer goes nowhere, so that the interpreter's own last flush cannot fail.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        if isinstance(error, BrokenPipeError):
            raise typer.Exit(NOBODY_READS) from None
        raise


@contextmanager
def warnings_told(tell: Callable[[str], None]) -> Iterator[None]:
    """Hand each warning to a function as one sentence, without its place in the code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: tell(str(message))
        yield


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn bad input, an answer out of reach, a bad setting or a missing extra into one line and a status."""
    try:
        with warnings_told(lambda sentence: print_failure(f"warning: {sentence}")):
            yield
    except KeyboardInterrupt:
        print_failure("interrupted; nothing was written")
        raise typer.Exit(INTERRUPTED) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print_failure("; ".join([f"{where}{error.strerror or error}", *getattr(error, "__notes__", ())]))
        raise typer.Exit(FAILED) from None
    except (ValueError, ArithmeticError, ImportError) as error:
        print_failure(str(error))
        raise typer.Exit(FAILED) from None
