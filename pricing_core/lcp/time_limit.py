"""The time that a solver may take: the only module in which the solvers read a clock."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from pricing_core.arrays import as_extended_number
from pricing_core.errors import InvalidInputError, IterationLimitError


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """A limit of `seconds` that an iteration checks now and then; None is no limit.

    A compiled iteration asks it every few milliseconds, which also lets Python handle an interrupt of the keyboard.

    Raises
    ------
    InvalidInputError
        `seconds` is no number above 0.
    """

    seconds: float | None
    _end: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        limit = math.inf if self.seconds is None else as_extended_number("time_limit", self.seconds)
        if not limit > 0.0:
            raise InvalidInputError("time_limit", self.seconds, "a number of seconds > 0, or None")
        object.__setattr__(self, "_end", time.monotonic() + limit)

    def __call__(self) -> bool:
        """Tell whether the time is over."""
        return time.monotonic() > self._end

    def left(self) -> float | None:
        """Return the seconds that are left, None without a limit."""
        return None if self.seconds is None else max(self._end - time.monotonic(), 1e-9)

    def check(self, work: str) -> None:
        """Raise IterationLimitError where the time is over; `work` begins its message."""
        if self():
            raise IterationLimitError(f"{work} did not end within time_limit = {self.seconds} seconds")
