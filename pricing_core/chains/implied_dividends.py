"""Cash dividends whose dates are known and whose amounts are not: those that call and put of a strike imply."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pricing_core.american.contracts.dividends import CashDividend
from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.implied_carry import discount, stock_value
from pricing_core.arrays import Vector
from pricing_core.chains.carry import Carry
from pricing_core.chains.yield_curve import random_walk
from pricing_core.errors import InvalidInputError, Told

PASSES = 6  # Largest number of times that early exercise is taken out at the amounts found before; chosen.
SETTLED = 1e-5  # Largest change of an amount, in spots, at which they stop; chosen.
# The premiums move the amounts back by about a third of what these are moved by; measured.
NEWTON = 0.75
UNKNOWN_AMOUNT = 0.0  # of a dividend before it is found


@dataclass(frozen=True, slots=True, eq=False)
class ImpliedDividends:
    """Times, years, amounts and their standard errors, money, of the dividends that are implied, each of shape (n,)."""

    time: Vector
    amount: Vector
    standard_error: Vector


NONE_IMPLIED = ImpliedDividends(np.empty(0), np.empty(0), np.empty(0))


def is_implied(dividend: Any) -> bool:
    """Whether a dividend has no amount."""
    return isinstance(dividend, Mapping) and dividend.get("amount") is None


def filled(dividends: Sequence[Any]) -> list[Any]:
    """Return dividends with an amount in the place of those that are to be implied."""
    return [{**each, "amount": UNKNOWN_AMOUNT} if is_implied(each) else each for each in dividends]


def imply_dividends(market: Market, times: Vector, carry_of: Callable[[Market], Carry]) -> ImpliedDividends:
    """Return the amounts at which the stock to be had at each expiry is worth what its pairs say, at no yield.

    The amounts are a random walk from one dividend to the next, whose step the quotes choose: where no expiry lies
    between two of them, or after the last one, they are alike. Early exercise is taken out at the amounts found before.

    Parameters
    ----------
    market : Market
        With the dividends that are given, and no yield.
    times : Vector, shape (n,)
        Ex-times of the others, years, increasing.
    carry_of : callable
        Returns the carry of the chain in a market.

    Raises
    ------
    InvalidInputError
        No expiry with a carry lies after the first of the dividends.
    """
    amount, discounted = (
        np.zeros(times.size),
        np.array([discount(market.rate, time) for time in times.tolist()]),
    )
    for _ in range(PASSES):
        carry = carry_of(with_dividends(market, times, amount))
        known = np.flatnonzero((carry.status == "ok") & (carry.expiry > times[0]))
        if known.size == 0:
            raise InvalidInputError(
                "cash_dividends",
                Told("a dividend without an amount"),
                "ones with an amount, or before an expiry with calls and puts of one strike",
            )
        bare = np.array([stock_value(market, 0.0, time) for time in carry.expiry[known].tolist()])
        paid = (times <= carry.expiry[known, None]) * discounted * market.spot
        error = carry.stock_error[known]
        mean, covariance = random_walk(paid / error[:, None], (bare - carry.stock[known]) / error)
        found = amount + NEWTON * (np.maximum(market.spot * mean, 0.0) - amount)
        change, amount = float(np.abs(found - amount).max()), found
        if change <= SETTLED * market.spot:
            break
    return ImpliedDividends(times, amount, market.spot * np.sqrt(np.diag(covariance)))


def with_dividends(market: Market, times: Vector, amounts: Vector) -> Market:
    """Return a market that pays more dividends."""
    more = [CashDividend(time, amount) for time, amount in zip(times.tolist(), amounts.tolist(), strict=True)]
    together = sorted([*market.cash_dividends, *more], key=lambda each: each.time)
    return replace(market, cash_dividends=tuple(together))
