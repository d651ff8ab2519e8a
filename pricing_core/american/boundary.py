"""The early exercise boundary as a function of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, TOLERANCE
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.times import checked_times
from pricing_core.american.engines.engine import Boundaries, BoundariesAt, Engine, Request
from pricing_core.american.engines.solve import ENGINES, boundary_of
from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import NumericalError

DEFAULT_POINTS = 101  # Number of times where none are given and nothing happens before expiry; chosen.
FEWEST_POINTS = 12  # Smallest number of times between two events; chosen.
JUST_AFTER = 1e-6  # Time just after an event, as a share of the time to the next one; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class ExerciseBoundary:
    """S* at increasing times; entries are NaN where the option is not exercised at any spot.

    Parameters
    ----------
    time, time_to_expiry : Vector, shape (m,)
        Years from now, and to expiry.
    boundary : Vector, shape (m,)
        Money; where there are two boundaries, the one nearer the strike.
    other_boundary : Vector, shape (m,), or None
        The one further from the strike; None where the exercise region has one end only.
    error_estimate : Vector, shape (m,)
        Estimated absolute error of `boundary`, in money; 0 at expiry.
    method : str
        "premium-march" or "obstacle-march", with commas
        where they found it together, each some of the times; "none" for an option that is never exercised early.
    """

    time: Vector
    time_to_expiry: Vector
    boundary: Vector
    other_boundary: Vector | None
    error_estimate: Vector
    method: str


@dataclass(frozen=True, slots=True)
class _Noted:
    """An engine, asked for boundaries alone, whose method is noted where it has found any."""

    engine: Engine
    methods: list[str]

    def serves(self, book: Book) -> BoolVector:
        return self.engine.serves(book)

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        boundary, method = self.engine.boundary(book, request), self.engine.method

        def noted(times: Vector) -> Boundaries:
            found = boundary(times)
            if found.found.any() and method not in self.methods:
                self.methods.append(method)
            return found

        return noted


def exercise_boundary(
    option: Option,
    market: Market,
    times: ArrayLike | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    interrupt: Callable[[], bool] | None = None,
) -> ExerciseBoundary:
    """Return the exercise boundary: within 1e-4 of itself at the default tolerance, 1e-5 at the smallest.

    Without events every time has a march of its own, scaled to the root of the time to expiry: the accuracy is the same
    close to expiry. Where there are two boundaries and events, or the fast engines do not settle, the march of
    obstacle problems is taken, with its own estimates.

    Parameters
    ----------
    option : Option
    market : Market
        The spot is not used.
    times : array_like, shape (m,), optional
        Years from now, increasing, 0 to expiry; by default 101 times, equally spaced in the square root of
        the time to expiry, with both ends, and the times of dividends, exercise dates and curve knots; of a Bermudan
        option these alone, for there is no boundary in between. At a time at which something happens the boundary is
        that just before, at expiry the limit.
    tolerance : float
        As in `price`; the boundary is found to a tenth of its square root, relative to itself.
    interrupt : callable, optional
        Asked before the work begins, and between the steps of the march of obstacle problems; True ends it.

    Returns
    -------
    ExerciseBoundary
        All NaN where early exercise is never optimal. With events NaN, too, where the boundary is so far away, more
        than five standard deviations of ln(spot), that it does not matter: a put before a dividend.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.
    NumericalError
        The interrupt came before the end.

    Examples
    --------
    >>> market = Market(spot=100.0, rate=0.05, volatility=0.2)
    >>> found = exercise_boundary(Option("put", 100.0, 1.0), market, times=[0.0, 1.0])
    >>> found.boundary.round(1), found.other_boundary
    (array([ 80.9, 100. ]), None)
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    tolerance = TOLERANCE.check(tolerance)
    book = Book.at_strike(option, market)
    if times is not None:
        chosen = checked_times(option, times)
    elif option.expiry == 0.0:
        chosen = np.zeros(1)
    elif option.exercise == "bermudan":  # there is none between
        chosen = np.unique(np.concatenate([[0.0], book.segments.end]))
    else:
        chosen = _times_around(book.segments.end)
    tau = np.maximum(option.expiry - chosen, 0.0)
    nothing = np.full(chosen.size, math.nan)
    if option.exercise == "european":
        return ExerciseBoundary(chosen, tau, nothing, None, nothing, "none")
    request = Request(np.array([tolerance]), interrupt=interrupt)
    request.end_if_interrupted()
    methods: list[str] = []
    engines = cast("Sequence[Engine]", [_Noted(engine, methods) for engine in ENGINES])
    found = boundary_of(book, request, engines)(chosen)
    if not found.found.all():
        raise NumericalError("no method could find the exercise boundary of this contract")
    other = None if np.isnan(found.far).all() else found.far
    return ExerciseBoundary(chosen, tau, found.near, other, found.error, ", ".join(methods))


def _times_around(events: Vector) -> Vector:
    """Return 0, the events' times, the last of which is the expiry, and others: close before, and one just after."""
    if events.size == 1:
        return np.asarray(events[0] * (1.0 - np.linspace(1.0, 0.0, DEFAULT_POINTS) ** 2))
    count = max(FEWEST_POINTS, DEFAULT_POINTS // events.size)
    inside = 1.0 - np.linspace(1.0, 0.0, count) ** 2
    inside[0] = JUST_AFTER
    starts = np.concatenate([[0.0], events[:-1]])
    return np.unique(np.concatenate([[0.0], events, (starts + np.outer(inside, events - starts)).ravel()]))
