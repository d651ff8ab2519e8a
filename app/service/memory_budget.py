"""The memory that bodies, and what is made of them, may take in a process: counted before it is taken."""

import threading
from collections import Counter

from app.service.errors import BodyTooLargeError, ClientLimitError, OverloadedError


class MemoryBudget:
    """The bytes that are held, all together and by client: two of the largest bodies, one for each client.

    Any thread may call the methods.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._held: Counter[str] = Counter()
        self._lock = threading.Lock()

    @property
    def held(self) -> int:
        """The bytes that are held now."""
        return self._held.total()

    def take(self, client: str, count: int) -> None:
        """Count bytes as held.

        Raises
        ------
        ClientLimitError, OverloadedError
            The client, or all together, would hold more than they may.
        """
        with self._lock:
            if self._held[client] + count > self.most:
                raise ClientLimitError("what this client has in work takes as much memory as it may")
            if self._held.total() + count > 2 * self.most:
                raise OverloadedError("what is in work takes as much memory as it may")
            self._held[client] += count

    def give_back(self, client: str, count: int) -> None:
        """Count bytes as free again."""
        with self._lock:
            self._held[client] -= count
            if not self._held[client]:
                del self._held[client]


class HeldMemory:
    """What one request holds of the budget, until it is released."""

    def __init__(self, budget: MemoryBudget, client: str) -> None:
        self._budget, self._client, self._count = budget, client, 0

    def take(self, count: int) -> None:
        """Hold further bytes.

        Raises
        ------
        BodyTooLargeError
            The request alone would hold more than a client may, whatever others do.
        ClientLimitError, OverloadedError
            As `MemoryBudget.take`.
        """
        if self._count + count > self._budget.most:
            raise BodyTooLargeError(
                "the body and its answer take more memory than one request may: send it in several parts"
            )
        self._budget.take(self._client, count)
        self._count += count

    def give_back(self, count: int) -> None:
        """Hold some bytes less."""
        self._budget.give_back(self._client, count)
        self._count -= count

    def release(self) -> None:
        """Hold nothing any more."""
        self.give_back(self._count)
