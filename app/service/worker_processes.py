"""Several server processes on one listening socket, and the parent that starts them again where one dies."""

import logging
import os
import signal
import time
from typing import NamedTuple, Protocol

log = logging.getLogger("pricing.workers")

SIGNALS = {signal.SIGTERM, signal.SIGINT, signal.SIGCHLD}
SHORTEST_LIFE = (
    1.0  # Seconds before which a worker that has died is not replaced, lest the parent do nothing else.
)
EXTRA_SECONDS = 5.0  # Beyond what a worker may take to stop; then it is killed; chosen.


class Workers(Protocol):
    """The steps of a process and of its parent, which `supervise` calls."""

    @property
    def stop_seconds(self) -> float:
        """Seconds that a process may take to stop."""
        ...

    def work(self, number: int) -> None:
        """Do the work of the process that has this number, from 0 on; return on SIGTERM."""
        ...

    def died(self, number: int) -> None:
        """Clean up after a process, in the parent, before another one takes its number."""
        ...

    def stopping(self) -> None:
        """Clean up in the parent before the processes are told to stop."""
        ...


class _Worker(NamedTuple):
    number: int
    started: float


def supervise(workers: Workers, count: int) -> None:
    """Keep `count` processes at work until SIGTERM or SIGINT, which they are sent too; return when all have ended."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    running = dict(_start(workers, number) for number in range(count))
    stops_by = None
    while running:
        left = None if stops_by is None else max(0.0, stops_by - time.monotonic())
        told = signal.sigwaitinfo(SIGNALS) if left is None else signal.sigtimedwait(SIGNALS, left)
        if told is None:
            _send(running, signal.SIGKILL)
            stops_by = time.monotonic() + EXTRA_SECONDS
        elif told.si_signo != signal.SIGCHLD:
            workers.stopping()
            _send(running, told.si_signo)
            stops_by = time.monotonic() + workers.stop_seconds + EXTRA_SECONDS
        for process, status in _ended(list(running)):
            number, started = running.pop(process)
            workers.died(number)
            if stops_by is None:
                log.error("a worker has died", extra={"fields": {"process": process, "status": status}})
                time.sleep(max(0.0, started + SHORTEST_LIFE - time.monotonic()))
                running.update([_start(workers, number)])
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _start(workers: Workers, number: int) -> tuple[int, _Worker]:
    process = os.fork()
    if process:
        return process, _Worker(number, time.monotonic())
    status = 1
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        workers.work(number)
        status = 0
    except Exception:
        log.exception("a worker cannot go on")
    finally:
        logging.shutdown()
        os._exit(status)


def _send(running: dict[int, _Worker], number: int) -> None:
    for process in running:
        os.kill(process, number)


def _ended(running: list[int]) -> list[tuple[int, int]]:
    """Return the processes that have ended, and how: minus the number of the signal that killed one."""
    found = [(process, os.waitpid(process, os.WNOHANG)) for process in running]
    return [(process, os.waitstatus_to_exitcode(status)) for process, (ended, status) in found if ended]
