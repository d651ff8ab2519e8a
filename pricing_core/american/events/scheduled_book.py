"""Contracts with events in columns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import make_schedule
from pricing_core.american.events.packed_schedules import PackedSchedules, pack
from pricing_core.arrays import Vector

Contract: TypeAlias = tuple[Option, Market]


@dataclass(frozen=True, slots=True, eq=False)
class ScheduledBook:
    """Contracts with events; every array has shape (n,).

    Parameters
    ----------
    spot : Vector
        Money, as it is quoted.
    dividends : int array
        How many cash dividends each market has.
    schedules : PackedSchedules
    contract : callable
        From the number of a row to its option and market, which few rows are asked for.
    """

    spot: Vector
    dividends: NDArray[np.int64]
    schedules: PackedSchedules
    contract: Callable[[int], Contract]

    def payoff(self) -> Vector:
        """Return what exercise brings now, money."""
        return np.maximum(self.schedules.sign * (self.schedules.strike - self.spot), 0.0)

    def take(self, rows: NDArray[np.intp]) -> "ScheduledBook":
        """Return some of the rows, in their order."""
        return ScheduledBook(
            self.spot[rows],
            self.dividends[rows],
            self.schedules.take(rows),
            lambda row: self.contract(int(rows[row])),
        )

    def joined(self, other: "ScheduledBook") -> "ScheduledBook":
        """Return these rows and then the others."""
        count = self.spot.size
        return ScheduledBook(
            np.concatenate([self.spot, other.spot]),
            np.concatenate([self.dividends, other.dividends]),
            self.schedules.joined(other.schedules),
            lambda row: self.contract(row) if row < count else other.contract(row - count),
        )


def scheduled_book(contracts: Sequence[Contract]) -> ScheduledBook:
    """Return the columns of contracts with events.

    Raises
    ------
    InvalidInputError
        Escrowed dividends are worth the spot or more.
    """
    return ScheduledBook(
        np.array([market.spot for _, market in contracts], dtype=np.float64),
        np.array([len(market.cash_dividends) for _, market in contracts], dtype=np.int64),
        pack([make_schedule(option, market) for option, market in contracts]),
        lambda row: contracts[row],
    )
