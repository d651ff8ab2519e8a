"""Derivatives by parameters, carried along with the value: with the contact set held fast they are linear problems.

The value is stationary in the exercise boundary, so that its derivative v_p solves v_p' = L v_p + L_p v where the
option is held, and is g_p where it is exercised: on the grid the same matrices as the value's, one more right-hand side
for each parameter and step. At an event they follow from the derivative of the event's own map. The kernel does that;
here is which parameters it is asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.schedule import LocalTerms
from pricing_core.american.engines.differences import STICKY, plan_directions

SURFACE_STEP = 1e-4  # How far a surface is moved in ln S; chosen.
TERMS = 5  # Number of a segment's numbers that a parameter may change.


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """A parameter, and the contract with a little more and a little less of it, cut like the contract itself.

    Parameters
    ----------
    kind : str
        The column of `Prices` that the derivative belongs to.
    entry : int
        The place in it.
    step : float
        Half of what the two differ by.
    terms : array, shape (M, 2, TERMS)
        Rate, dividend yield, volatility, amount and escrow of each segment, the last two in strikes.
    spot : float
        What the spot that diffuses changes by in units of the strike: escrowed dividends reduce it.
    surfaces : tuple of LocalTerms
        The two local volatilities, where the parameter changes more than their parallel shift; else nothing.
    """

    kind: str
    entry: int
    step: float
    terms: NDArray[np.float64]
    spot: float = 0.0
    surfaces: tuple[LocalTerms, ...] = ()


def directions_of(book: Book, *, extended: bool, only: str = "") -> tuple[Direction, ...]:
    """Return the parameters of a book of one contract; none where one asks for a further cut.

    Parameters
    ----------
    only : str
        The one kind that is wanted, if not all are.
    """
    planned = plan_directions(book, extended=extended, only=only)
    if not planned:
        return ()
    strike, bumped = book.strike.item(0), Book.concatenated([side for each in planned for side in each.sides])
    terms, shape = _terms(bumped), (len(planned), 2, -1, TERMS)
    spots = (bumped.spot - bumped.escrow_now()).reshape(-1, 2)
    found = [
        Direction(each.kind, each.entry, each.step, own, (up - down) / (2.0 * each.step * strike))
        for each, own, (up, down) in zip(
            planned, terms.reshape(shape).swapaxes(1, 2), spots.tolist(), strict=True
        )
    ]
    if book.local is not None and book.local[0] is not None and not only:
        both = tuple(moved(book.local[0], side * SURFACE_STEP) for side in (1.0, -1.0))
        found.append(Direction(STICKY, 0, SURFACE_STEP, np.stack([_terms(book)] * 2, axis=1), 0.0, both))
    return tuple(found)


def _terms(book: Book) -> NDArray[np.float64]:
    """Return the numbers of every segment that a parameter may change, shape (m, TERMS)."""
    segments, strike = book.segments, book.per_segment(book.strike)
    rates = segments.rate, segments.dividend_yield, segments.volatility
    return np.stack([*rates, book.drops() / strike, book.escrow() / strike], axis=1)


def moved(local: LocalTerms, by: float) -> LocalTerms:
    """Return a local volatility with its spots moved by so much in ln S."""
    return replace(local, volatility=local.volatility.moved(math.exp(by)))
