"""What the collocation finds of contracts with events, in money, and prices from what is found in whatever way."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.events.certain_schedule import uncertainty
from pricing_core.american.events.collocation import Solved, is_served, solve_to_tolerance
from pricing_core.american.events.packed_schedules import PackedSchedules
from pricing_core.american.events.scheduled_book import ScheduledBook
from pricing_core.american.events.scheduled_greeks import ScheduledGreeks
from pricing_core.american.priced_rows import PricedRows
from pricing_core.american.results import NO_FURTHER_GREEKS, FurtherGreeks
from pricing_core.arrays import BoolVector, Vector

ROUGH = 1e-6  # strikes: a larger error that misses its tolerance is one for the general path
SURE_SHARE = 0.1  # of the tolerance: what chance may add where it is left out


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Values with their derivatives by the spot, as if the options were held; money, every array of shape (n,).

    Parameters
    ----------
    value, european, delta, gamma, error : Vector
    boundary : Vector
        S* now, NaN without one.
    exercised : bool array
        Whether the spot lies in the closed exercise region.
    """

    value: Vector
    european: Vector
    delta: Vector
    gamma: Vector
    error: Vector
    boundary: Vector
    exercised: BoolVector


def found_alone(
    *,
    value: float,
    european: float,
    delta: float,
    gamma: float,
    error: float,
    boundary: float,
    exercised: bool,
) -> Found:
    """Return what is found of one contract."""
    return Found(
        value=np.array([value]),
        european=np.array([european]),
        delta=np.array([delta]),
        gamma=np.array([gamma]),
        error=np.array([error]),
        boundary=np.array([boundary]),
        exercised=np.array([exercised]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """What the collocation found.

    Parameters
    ----------
    rows : int array, shape (n,)
        Those of the schedules that it serves and settles.
    level : int array, shape (n,)
    found : Found
    """

    rows: NDArray[np.intp]
    level: NDArray[np.int64]
    found: Found


def is_certain(schedules: PackedSchedules, tolerance: Vector) -> BoolVector:
    """Tell where chance makes no difference at the tolerance, a fraction of the strike."""
    return uncertainty(schedules) <= SURE_SHARE * tolerance * schedules.strike


def collocate(schedules: PackedSchedules, tolerance: Vector, threads: int) -> Settled:
    """Solve the schedules that the collocation serves; what it leaves rougher than the general path could is left out.

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Fractions of the strike.
    """
    rows = np.flatnonzero(is_served(schedules) & ~is_certain(schedules, tolerance))
    served = schedules.take(rows)
    solved = solve_to_tolerance(served, tolerance[rows], threads)
    sound = np.flatnonzero(solved.settled & (solved.error <= np.maximum(tolerance[rows], ROUGH)))
    solved = solved.take(sound)
    return Settled(rows[sound], solved.level, _in_money(served.take(sound), solved))


def _in_money(schedules: PackedSchedules, solved: Solved) -> Found:
    """Return money for what is in strikes; what a value lacks of a bound that it cannot be under counts as error."""
    K, S, sign, escrow = schedules.strike, schedules.spot, schedules.sign, schedules.escrow_now()
    value, european = K * solved.value, K * solved.european
    now = np.where(schedules.first_columns().exercisable > 0.0, sign * (K - escrow - S), -np.inf)
    least = np.maximum(european, now)
    return Found(
        value=np.maximum(value, least),
        european=european,
        delta=K / S * solved.slope,
        gamma=K / S * ((solved.curvature - solved.slope) / S),
        error=np.maximum(K * solved.error, least - value),
        boundary=K * np.exp(solved.boundary) + escrow,
        exercised=sign * (solved.boundary - schedules.x) >= 0.0,
    )


def priced_rows(book: ScheduledBook, found: Found, greeks: Mapping[int, ScheduledGreeks]) -> PricedRows:
    """Return the prices; in the exercise region they and their derivatives are the payoff's.

    Theta is dV/dt where the option is held, from (11.46); in the escrowed model A grows under a given spot.

    Parameters
    ----------
    greeks : mapping of int to ScheduledGreeks
        By row; NaN in the others that are held.
    """
    schedules, exercised, payoff = book.schedules, found.exercised, book.payoff()
    now, S = schedules.first_columns(), schedules.spot
    drift = (now.rate - now.dividend_yield) * S + now.rate * schedules.escrow_now()
    theta = now.rate * found.value - drift * found.delta - 0.5 * (now.volatility * S) ** 2 * found.gamma
    vega, rho, dividend_rho = np.where(exercised, 0.0, np.full((3, payoff.size), np.nan))
    for row, derivatives in greeks.items():
        vega[row], rho[row] = derivatives.vega, derivatives.rho
        dividend_rho[row] = derivatives.dividend_rho
    return PricedRows(
        value=np.where(exercised, payoff, found.value),
        european=found.european,
        delta=np.where(exercised, -schedules.sign, found.delta),
        gamma=np.where(exercised, 0.0, found.gamma),
        theta=np.where(exercised, 0.0, theta),
        vega=vega,
        rho=rho,
        dividend_rho=dividend_rho,
        boundary=found.boundary,
        error=found.error,
        exercised=exercised & (payoff > 0.0),
    )


def further_greeks(
    book: ScheduledBook, found: Found, greeks: Mapping[int, ScheduledGreeks], row: int
) -> FurtherGreeks:
    """Return what else is known of one row; in the exercise region dividends make no difference."""
    if found.exercised[row]:
        return FurtherGreeks((0.0,) * int(book.dividends[row]) or None)
    return greeks[row].further if row in greeks else NO_FURTHER_GREEKS
