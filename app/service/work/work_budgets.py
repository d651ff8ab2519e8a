"""The budget of thread time that each client has in a minute, where its key states one."""

import math
import time
from collections.abc import Callable

from app.service.errors import ClientLimitError


class WorkBudgets:
    """Budgets of thread time that are refilled continuously and hold at most one minute's share.

    Work that has begun is never ended for want of budget, and is charged in full afterwards.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._spent: dict[str, tuple[float, float]] = {}  # seconds owed, and when that was

    def check(self, client: str, per_minute: float) -> None:
        """Raise where a client has no budget left to begin work.

        Raises
        ------
        ClientLimitError
            It has used up what it may.
        """
        over = self._owed(client, per_minute) - per_minute
        if over >= 0.0:
            words = f"this client's expensive questions have taken {per_minute:g} s in a minute, which is its limit"
            raise ClientLimitError(words, retry_after=max(1, math.ceil(60.0 * over / per_minute)))

    def spend(self, client: str, per_minute: float, seconds: float) -> None:
        """Charge a client for work."""
        self._spent[client] = self._owed(client, per_minute) + seconds, self._clock()

    def _owed(self, client: str, per_minute: float) -> float:
        owed, then = self._spent.get(client, (0.0, 0.0))
        return max(0.0, owed - (self._clock() - then) * per_minute / 60.0)
