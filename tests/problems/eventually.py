"""Waiting for what comes sooner or later, however fast the machine is."""

import time
from collections.abc import Callable

PATIENCE = 120.0  # seconds after which what does not come is given up, however slow the machine is


def eventually(holds: Callable[[], bool]) -> bool:
    """Wait until something holds, and return whether it does."""
    end = time.monotonic() + PATIENCE
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
