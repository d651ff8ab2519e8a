"""What comes before any command: standard streams that are closed, and signals that arrive before there is any work."""

import json
import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130  # 128 + SIGINT, as shells have it
SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
NOTHING_WRITTEN = "interrupted; nothing was written"


def open_closed_streams() -> None:
    """Open standard streams that are closed, lest another file take their place.

    Reading such an input and writing to such an output fails, as it does of a closed file. What is written to such an
    error stream goes nowhere.
    """
    streams = ("stdin", os.O_WRONLY), ("stdout", os.O_RDONLY), ("stderr", os.O_WRONLY)
    for number, (name, flags) in enumerate(streams):
        if getattr(sys, name) is not None:
            continue
        descriptor = os.open(os.devnull, flags)
        if descriptor != number:
            os.dup2(descriptor, number)
            os.close(descriptor)
        os.set_inheritable(number, True)
        stream = open(number, "r" if name == "stdin" else "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        setattr(sys, name, stream)


def end_by_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP end the process as they do later; a command may then take them otherwise.

    `pricing serve` ends with status 0, by SIGHUP as by default; other commands say that nothing was written.
    """
    serves = sys.argv[1:2] == ["serve"]
    for number in SIGNALS:
        is_taken = not (serves and number == signal.SIGHUP) and signal.getsignal(number) != signal.SIG_IGN
        if is_taken:  # others are ignored, as nohup has it, or left as they are
            signal.signal(number, _end_server if serves else _end_command)


def leave_signals() -> None:
    """Let signals end the process by default from here on: the work is done, and its status is known."""
    for number in SIGNALS:
        if signal.getsignal(number) in (_end_server, _end_command):
            signal.signal(number, signal.SIG_DFL)


def _end_server(number: int, frame: FrameType | None) -> None:
    raise SystemExit(0)


def _end_command(number: int, frame: FrameType | None) -> None:
    in_json = "--log-json" in sys.argv
    line = (
        json.dumps({"event": "error", "message": NOTHING_WRITTEN})
        if in_json
        else f"pricing: {NOTHING_WRITTEN}"
    )
    print(line, file=sys.stderr, flush=True)
    raise SystemExit(INTERRUPTED)
