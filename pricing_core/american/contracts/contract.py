"""The option contract: what the holder may do and what it pays."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from typing import Any

import numpy as np

from pricing_core.american.contracts.dates import (
    AnyDate,
    expiry_from_dates,
    is_date,
    moment_of_valuation,
    years_from_now,
)
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
from pricing_core.american.contracts.json_text import from_text
from pricing_core.american.contracts.names import DATES_INSTEAD, arguments_named
from pricing_core.errors import InvalidInputError, MissingInputError, Told

NOT_GIVEN = float("nan")  # an object of its own, and told by that


@arguments_named
@dataclass(frozen=True, slots=True)
class Option:
    """The right to sell (put) or buy (call) one unit of the underlying for the strike.

    Parameters
    ----------
    option_type : {"put", "call"}
        In any case; or "p" and "c".
    strike : float
        Money per unit of underlying, 1e-30 to 1e30.
    expiry : float
        Time to expiry in years, 0 to 200; not given where the dates are.
    exercise : {"american", "european", "bermudan"}
        At any time, at expiry only, or at the exercise times and at expiry.
    exercise_times : sequence of float or date
        Years from now, in (0, expiry], in any order; with "bermudan" only, and at least one. Where there is a
        valuation date they may be dates, and are kept as years.
    exercise_start : float or date
        Years from now, 0 to expiry: before it an American option may not be exercised. Where there is a valuation
        date it may be a date, which may lie before that.
    settlement_lag : float
        Calendar days, of 1/365 year, from exercise or expiry to payment, 0 to 366: what is paid is worth the payoff
        discounted over them.
    expiration_date, valuation_date : str, datetime.date, datetime.datetime or numpy.datetime64, optional
        In the place of expiry, which is then the `year_fraction` between them; they are not kept.

    At an exercise time that is an ex-time the holder decides before the dividend.

    Raises
    ------
    InvalidInputError
        A field lies outside what is allowed.

    Examples
    --------
    >>> Option("put", strike=100.0, expiry=1.0).payoff(90.0)
    10.0
    >>> Option("P", 100.0, valuation_date="2026-01-01", expiration_date="2027-01-01").expiry
    1.0
    """

    option_type: OptionType
    strike: float
    expiry: float = NOT_GIVEN
    exercise: Exercise = "american"
    exercise_times: tuple[float, ...] = ()
    exercise_start: float = 0.0
    settlement_lag: float = 0.0
    expiration_date: InitVar[AnyDate | None] = None
    valuation_date: InitVar[AnyDate | None] = None

    def __post_init__(self, expiration_date: AnyDate | None, valuation_date: AnyDate | None) -> None:
        object.__setattr__(self, "option_type", OPTION_TYPE.check_choice(self.option_type))
        object.__setattr__(self, "exercise", EXERCISE.check_choice(self.exercise))
        object.__setattr__(self, "strike", STRIKE.check(self.strike))
        now = moment_of_valuation(valuation_date)
        object.__setattr__(self, "expiry", self._checked_expiry(now, expiration_date))
        if self.exercise == "bermudan" or type(self.exercise_times) is not tuple or self.exercise_times:
            object.__setattr__(self, "exercise_times", self._checked_times(now))
        if self.exercise_start != 0.0 or not isinstance(self.exercise_start, float):
            object.__setattr__(self, "exercise_start", self._checked_start(now))
        if self.settlement_lag != 0.0 or not isinstance(self.settlement_lag, float):
            object.__setattr__(self, "settlement_lag", SETTLEMENT_LAG.check(self.settlement_lag))

    def _checked_expiry(self, now: dt.datetime | None, expiration_date: AnyDate | None) -> float:
        """Return the expiry, which may be given by dates."""
        is_given = not (self.expiry is NOT_GIVEN or self.expiry is None)
        if expiration_date is None and now is None:
            if is_date(self.expiry):
                raise InvalidInputError(
                    "expiry", self.expiry, f"{EXPIRY.allowed}, in years; or {DATES_INSTEAD}"
                )
            if not is_given:
                raise MissingInputError("expiry", f"give it, or {DATES_INSTEAD}")
            return EXPIRY.check(self.expiry)
        if is_given:
            raise InvalidInputError("expiry", self.expiry, "left out where dates are given")
        if expiration_date is None:
            raise MissingInputError("expiration_date", "valuation_date needs it")
        if now is None:
            raise MissingInputError("valuation_date", "expiration_date needs it")
        return expiry_from_dates(now, expiration_date)

    def _checked_times(self, now: dt.datetime | None) -> tuple[float, ...]:
        """Return the exercise times in order, each once, as years."""
        times = from_text(EXERCISE_TIMES, self.exercise_times)
        if not isinstance(times, Sequence | np.ndarray) or isinstance(times, str | bytes):
            raise InvalidInputError("exercise_times", times, EXERCISE_TIMES.allowed)
        if self.exercise != "bermudan":
            if len(times) == 0:
                return ()
            raise InvalidInputError("exercise_times", list(times), 'empty unless exercise is "bermudan"')
        most = EXERCISE_TIMES.most_entries
        if not 1 <= len(times) <= most:
            raise InvalidInputError("exercise_times", Told(f"{len(times)} times"), f"1 to {most} times")
        read = {self._checked_time(f"exercise_times[{i}]", time, now) for i, time in enumerate(times)}
        return tuple(sorted(read))

    def _checked_time(self, place: str, time: Any, now: dt.datetime | None) -> float:
        """Return one exercise time as years from now; `place` names it in the list."""
        if is_date(time):
            years = years_from_now(now, place, time)
            if not 0.0 < years <= self.expiry:
                raise InvalidInputError(
                    place, str(time), "after valuation_date, and not after expiration_date"
                )
            return years
        years = EXERCISE_TIMES.check(time, place)
        if not 0.0 < years <= self.expiry:
            raise InvalidInputError(place, years, f"above 0 and at most the expiry, {self.expiry:g}")
        return years

    def _checked_start(self, now: dt.datetime | None) -> float:
        """Return the start of the exercise window as years from now: 0 where a date says that it is open already."""
        given: Any = self.exercise_start
        if is_date(given):
            start = max(years_from_now(now, "exercise_start", given), 0.0)
            if start > self.expiry:
                raise InvalidInputError(
                    "exercise_start", str(given), "a date that is not after expiration_date"
                )
        else:
            start = EXERCISE_START.check(given)
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
