"""The option contract: what the holder may do and what it pays."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pricing_core.american.contracts.fields import (
    EXERCISE,
    EXERCISE_START,
    EXERCISE_TIMES,
    EXPIRY,
    OPTION_TYPE,
    SETTLEMENT_LAG,
    STRIKE,
    Exercise,
    OptionType,
)
from pricing_core.american.contracts.names import arguments_named
from pricing_core.errors import InvalidInputError, Told

DATES_INSTEAD = "in its place contract_from and tables take valuation_date and expiration_date"


@arguments_named
@dataclass(frozen=True, slots=True)
class Option:
    """The right to sell (put) or buy (call) one unit of the underlying for the strike.

    Parameters
    ----------
    option_type : {"put", "call"}
    strike : float
        Money per unit of underlying, 1e-30 to 1e30.
    expiry : float
        Time to expiry in years, 0 to 200.
    exercise : {"american", "european", "bermudan"}
        At any time, at expiry only, or at the exercise times and at expiry.
    exercise_times : sequence of float
        Years from now, in (0, expiry], in any order; with "bermudan" only, and at least one.
    exercise_start : float
        Years from now, 0 to expiry: before it an American option may not be exercised.
    settlement_lag : float
        Calendar days, of 1/365 year, from exercise or expiry to payment, 0 to 366: what is paid is worth the payoff
        discounted over them.

    At an exercise time that is an ex-time the holder decides before the dividend.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.

    Examples
    --------
    >>> Option("put", strike=100.0, expiry=1.0).payoff(90.0)
    10.0
    """

    option_type: OptionType
    strike: float
    expiry: float
    exercise: Exercise = "american"
    exercise_times: tuple[float, ...] = ()
    exercise_start: float = 0.0
    settlement_lag: float = 0.0

    def __post_init__(self) -> None:
        OPTION_TYPE.check_choice(self.option_type)
        EXERCISE.check_choice(self.exercise)
        object.__setattr__(self, "strike", STRIKE.check(self.strike))
        if isinstance(self.expiry, (str, dt.date, np.datetime64)):
            raise InvalidInputError("expiry", self.expiry, f"{EXPIRY.allowed}, in years; {DATES_INSTEAD}")
        object.__setattr__(self, "expiry", EXPIRY.check(self.expiry))
        if self.exercise == "bermudan" or type(self.exercise_times) is not tuple or self.exercise_times:
            object.__setattr__(self, "exercise_times", self._checked_times())
        if self.exercise_start != 0.0 or not isinstance(self.exercise_start, float):
            object.__setattr__(self, "exercise_start", self._checked_start())
        if self.settlement_lag != 0.0 or not isinstance(self.settlement_lag, float):
            object.__setattr__(self, "settlement_lag", SETTLEMENT_LAG.check(self.settlement_lag))

    def _checked_times(self) -> tuple[float, ...]:
        """Return the exercise times in order, each once."""
        times = self.exercise_times
        if not isinstance(times, Sequence | np.ndarray) or isinstance(times, str | bytes):
            raise InvalidInputError("exercise_times", times, EXERCISE_TIMES.allowed)
        if self.exercise != "bermudan":
            if len(times) == 0:
                return ()
            raise InvalidInputError("exercise_times", list(times), 'empty unless exercise is "bermudan"')
        most = EXERCISE_TIMES.most_entries
        if not 1 <= len(times) <= most:
            raise InvalidInputError("exercise_times", Told(f"{len(times)} times"), f"1 to {most} times")
        read = {EXERCISE_TIMES.check(time) for time in times}
        for time in read:
            if not 0.0 < time <= self.expiry:
                raise InvalidInputError(
                    "exercise_times", time, f"above 0 and at most the expiry, {self.expiry:g}"
                )
        return tuple(sorted(read))

    def _checked_start(self) -> float:
        start = EXERCISE_START.check(self.exercise_start)
        if start > self.expiry:
            raise InvalidInputError("exercise_start", start, f"at most the expiry, {self.expiry:g}")
        if start > 0.0 and self.exercise != "american":
            raise InvalidInputError("exercise_start", start, '0 unless exercise is "american"')
        return start

    @property
    def is_put(self) -> bool:
        """Whether the holder may sell."""
        return self.option_type == "put"

    def payoff(self, spot: float) -> float:
        """Return what exercise brings at `spot`, paid after the lag, in money per unit of underlying (11.47)."""
        return max(self.strike - spot if self.is_put else spot - self.strike, 0.0)
