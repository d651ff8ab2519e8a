"""What a client may have parsed: so many pieces a second, and so many at once."""

import time
from collections.abc import Callable


class Allowance:
    """Pieces that may be parsed. Work that is done already may leave a debt, which is waited for.

    Parameters
    ----------
    rate : float
        Pieces a second.
    most : float
        Pieces that are there at first, and after a pause.
    clock : callable
        The time in seconds.

    Examples
    --------
    >>> allowance = Allowance(rate=10.0, most=100.0, clock=lambda: 0.0)
    >>> allowance.charge(100), allowance.charge(20)
    (0.0, 7.0)
    """

    def __init__(self, rate: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._most, self._clock = rate, most, clock
        self._left, self._last = most, clock()

    def charge(self, pieces: int) -> float:
        """Count pieces as parsed; return the seconds to wait for half of the most, 0 where there is no debt."""
        now = self._clock()
        self._left = min(self._most, self._left + self._rate * (now - self._last)) - pieces
        self._last = now
        return 0.0 if self._left >= 0.0 else (0.5 * self._most - self._left) / self._rate
