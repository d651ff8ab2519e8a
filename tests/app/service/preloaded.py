"""A process that has imported the service, and forks `pricing` wherever a test starts one: its imports take longest.

What a process does from `main` on is its own. How `pricing serve` comes to that point is tested in `test_start_up` and
`test_server_environment`, by processes that start from nothing.
"""

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, TextIO

LONGEST = 1 << 16  # bytes of a message


class Forked:
    """A process of `pricing`, to its user like `subprocess.Popen`.

    Parameters
    ----------
    held : bool
        Whether work can be held, as in `tests.app.held_work`.
    """

    def __init__(self, arguments: list[str], environment: dict[str, str], held: bool) -> None:
        reading, writing = os.pipe()
        start = {"arguments": arguments, "environment": environment, "held": held}
        self.pid: int = _ask(_preloaded(), start, writing)
        os.close(writing)
        self._ended = os.pidfd_open(self.pid)
        self._status: int | None = None
        self.stderr: TextIO = open(reading, encoding="utf-8")  # noqa: SIM115

    def poll(self) -> int | None:
        """Return the exit status, or None while the process runs."""
        if self._status is None and select.select([self._ended], [], [], 0.0)[0]:
            self._status = _ask(_preloaded(), {"ended": self.pid})
            os.close(self._ended)
        return self._status

    def wait(self, timeout: float) -> int:
        """Return the exit status once the process has ended; raise where it does not in so many seconds."""
        if self._status is None and not select.select([self._ended], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired("pricing", timeout)
        status = self.poll()
        assert status is not None
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End the process at once, unless it has ended."""
        self.send_signal(signal.SIGKILL)


@cache
def _preloaded() -> socket.socket:
    """Start the process once, and return the socket to it; it ends when the socket is closed."""
    mine, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.app.service.preloaded", str(theirs.fileno())],
        cwd=Path(__file__).parents[3],
        stdin=subprocess.DEVNULL,
        pass_fds=[theirs.fileno()],
    )
    theirs.close()
    atexit.register(lambda: (mine.close(), process.wait()))
    return mine


def _ask(preloaded: socket.socket, question: dict[str, Any], *descriptors: int) -> int:
    socket.send_fds(preloaded, [json.dumps(question).encode()], list(descriptors))
    return int(preloaded.recv(LONGEST))


def main() -> None:
    """Fork where a process is asked for, and tell the status of one that has ended."""
    import app.main  # noqa: PLC0415
    import app.service.server  # noqa: F401, PLC0415
    from app.__main__ import main as pricing  # noqa: PLC0415

    asked = socket.socket(fileno=int(sys.argv[1]))
    while True:
        message, descriptors, _, _ = socket.recv_fds(asked, LONGEST, 1)
        if not message:
            return
        question = json.loads(message)
        if "ended" in question:
            status = os.waitstatus_to_exitcode(os.waitpid(question["ended"], 0)[1])
            asked.send(str(status).encode())
        elif process := os.fork():
            os.close(descriptors[0])
            asked.send(str(process).encode())
        else:
            asked.close()
            os.dup2(descriptors[0], 2)
            os.close(descriptors[0])
            os.environ.clear()
            os.environ.update(question["environment"])
            sys.argv = ["pricing", *question["arguments"]]
            if question["held"]:
                from tests.app.held_work import prepare  # noqa: PLC0415

                prepare()
            pricing()
            return


if __name__ == "__main__":
    main()
