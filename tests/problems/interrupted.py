"""Interrupting what runs in the main thread, as the keyboard does."""

import gc
import math
import signal
import time
from collections.abc import Callable

AGAIN = 5.0  # seconds


def seconds_until_interrupted(run: Callable[[], object], after: float) -> float:
    """Run, interrupt as by Ctrl-C after so many seconds, and return the processor time that the run then still took.

    The processor time of this thread does not depend on what else the machine does. The garbage collector is off:
    Python drops exceptions that are raised within its callbacks, which some test tools install. A run that drops the
    first interrupt gets others, and the time since the first one tells.
    """
    interrupted_at: list[float] = []
    running = True

    def interrupt(*_: object) -> None:
        interrupted_at.append(time.thread_time())
        if running:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    gc.disable()
    try:
        signal.setitimer(signal.ITIMER_REAL, after, AGAIN)
        run()
    except KeyboardInterrupt:
        running = False
        return time.thread_time() - interrupted_at[0]
    finally:
        running = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        gc.enable()
    raise AssertionError("the run ended before it was interrupted")


class Deadline:
    """An interrupt that comes at the given time that it is asked, and counts how often it is."""

    def __init__(self, at=math.inf):
        self.at, self.asked = at, 0

    def __call__(self):
        self.asked += 1
        return self.asked >= self.at
