"""Several server processes on one listening socket, and the parent that starts them again where one dies."""

import logging
import os
import signal
import time
from collections.abc import Callable

log = logging.getLogger("pricing.workers")

SIGNALS = {signal.SIGTERM, signal.SIGINT, signal.SIGCHLD}
SHORTEST_LIFE = (
    1.0  # Seconds before which a worker that has died is not replaced, lest the parent do nothing else.
)
EXTRA_SECONDS = 5.0  # Beyond what a worker may take to stop; then it is killed; chosen.


def supervise(work: Callable[[], None], count: int, stop_seconds: float) -> None:
    """Keep `count` processes at `work` until SIGTERM or SIGINT, which they are sent too; return when all have ended.

    Parameters
    ----------
    work : callable
        What each process does; it returns on SIGTERM.
    stop_seconds : float
        How long it may take to.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    workers = {_start(work): time.monotonic() for _ in range(count)}
    stops_by = None
    while workers:
        left = None if stops_by is None else max(0.0, stops_by - time.monotonic())
        told = signal.sigwaitinfo(SIGNALS) if left is None else signal.sigtimedwait(SIGNALS, left)
        if told is None:
            _send(workers, signal.SIGKILL)
            stops_by = time.monotonic() + EXTRA_SECONDS
        elif told.si_signo != signal.SIGCHLD:
            _send(workers, told.si_signo)
            stops_by = time.monotonic() + stop_seconds + EXTRA_SECONDS
        for process, status in _ended(list(workers)):
            started = workers.pop(process)
            if stops_by is None:
                log.error("a worker has died", extra={"fields": {"process": process, "status": status}})
                time.sleep(max(0.0, started + SHORTEST_LIFE - time.monotonic()))
                workers[_start(work)] = time.monotonic()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _start(work: Callable[[], None]) -> int:
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
        work()
        status = 0
    except Exception:
        log.exception("a worker cannot go on")
    finally:
        logging.shutdown()
        os._exit(status)


def _send(workers: dict[int, float], number: int) -> None:
    for process in workers:
        os.kill(process, number)


def _ended(workers: list[int]) -> list[tuple[int, int]]:
    """Return the processes that have ended, and how: minus the number of the signal that killed one."""
    found = [(process, os.waitpid(process, os.WNOHANG)) for process in workers]
    return [(process, os.waitstatus_to_exitcode(status)) for process, (ended, status) in found if ended]
