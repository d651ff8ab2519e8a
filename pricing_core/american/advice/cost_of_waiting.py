"""What a holder loses by waiting instead of exercising now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import solve
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError


@dataclass(frozen=True, slots=True, eq=False)
class Costs:
    """What waiting costs, and how it was found.

    Parameters
    ----------
    exercise_now : bool
        Whether exercise is optimal now.
    cost, error : Vector, shape (m,)
        Money; the cost does not fall.
    status : {"ok", "tolerance_not_met"}
        Whether every price meets the tolerance.
    methods : set of str
        Methods by which the prices were found.
    """

    exercise_now: bool
    cost: Vector
    error: Vector
    status: str
    methods: set[str]


def cost_of_waiting(
    option: Option, market: Market, times: Vector, tolerance: float, interrupt: Callable[[], bool] | None
) -> Costs:
    """Return what the option is worth more than one that cannot be exercised before each time.

    This is the integral of the multiplier, discounted, over the time until then, under the law of a holder who does not
    exercise, with the loss at each ex-date before which exercise was better: at expiry the early exercise premium.

    Parameters
    ----------
    option : Option
    market : Market
    times : Vector, shape (m,)
        Increasing, 0 to the expiry.
    tolerance : float
        Tolerance of both prices.

    Raises
    ------
    NumericalError
        The interrupt came before the end, or a price was not found.
    """
    contracts = [(option, market), *((_waited(option, time), market) for time in times.tolist())]
    book = Book.of(contracts)
    found = solve(book, Request(np.full(book.count, tolerance), "none", interrupt=interrupt))
    if np.isnan(found.value).any() or "deadline" in found.status:
        raise NumericalError("the cost of waiting was not found: allow more time or a larger tolerance")
    value = found.value - found.value[0]
    cost = np.maximum.accumulate(np.maximum(-value[1:], 0.0))
    status = "ok" if (found.status == "ok").all() else "tolerance_not_met"
    error = found.error[1:] + found.error[0]
    return Costs(bool(found.exercised[0]), cost, error, status, set(found.method.tolist()))


def _waited(option: Option, time: float) -> Option:
    """Return the option without the right to exercise before a time."""
    if option.exercise == "american":
        start = max(option.exercise_start, time)
        if start >= option.expiry:
            return replace(option, exercise="european", exercise_start=0.0)
        return replace(option, exercise_start=start)
    left = tuple(when for when in option.exercise_times if when >= time)
    exercise = option.exercise if left else "european"
    return replace(option, exercise=exercise, exercise_times=left)
