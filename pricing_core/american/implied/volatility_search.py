"""The search for the volatilities at which a pricer meets given prices: safeguarded Newton, many at once.

Newton's steps are taken in the coordinate of `volatility_targets`. The first prices come at a coarse tolerance, with
their vega where that is cheap; the last ones, a coarse step away, without, and the slope is that of the secant. A
bracket holds every step, and is halved where the steps take too many prices.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.prices import Prices
from pricing_core.american.contracts.fields import TOLERANCE, VOLATILITY
from pricing_core.american.implied.volatility_targets import (
    Coordinate,
    Targets,
    choose_coordinate,
    first_volatility,
)
from pricing_core.arrays import BoolVector, Vector

ImpliedStatus: TypeAlias = Literal[
    "ok", "below_lower_bound", "above_upper_bound", "not_identifiable", "no_convergence", "invalid_input"
]
STATUSES: tuple[ImpliedStatus, ...] = (
    "ok",
    "below_lower_bound",
    "above_upper_bound",
    "not_identifiable",
    "no_convergence",
    "invalid_input",
)
OK, BELOW, ABOVE, NOT_IDENTIFIABLE, NO_CONVERGENCE, INVALID, NOT_SERVED, OPEN = range(8)
MOST_PRICINGS = 60  # Largest number of prices for one volatility; chosen.
PATIENCE = 6  # Number of prices from which every other step halves or widens the bracket; chosen.
ROUNDING = 1e-12  # Largest distance of a price to its bounds that is rounding, over strike plus spot; chosen.
COARSE = 1e-4  # Tolerance of the first prices, in strikes; calibrated.
COARSE_SHARE = 0.05  # Largest tolerance of the first prices, as a share of the time value; calibrated.
COARSE_GAIN = 4.0  # Smallest coarse tolerance over the fine one that is worth a stage of its own; calibrated.
# Distance of price and target, in coarse tolerances, that ends the coarse stage; calibrated.
COARSE_REACH = 4.0
FINE_SHARE = 0.25  # Tolerance of the last prices, as a share of the one asked for; chosen.
GAP_SHARE = 0.5  # Largest distance of price and target, as a share of the tolerance; chosen.
GAP_OF_TIME_VALUE = 0.05  # The same as a share of the time value, where that is small; chosen.
LARGEST_ERROR = 10.0  # Largest error of a price that is believed, in tolerances; chosen.
FIRST_SLOPE = 2.0  # Slope to begin with next to the exercise region, in y over the volatility; calibrated.
LARGEST_FACTOR = 3.0  # Largest factor of the volatility in a step without Newton and bracket; chosen.
LARGEST_NEWTON = 2.5  # Largest change of ln(volatility) in a Newton step; chosen.
NARROWEST_BRACKET = 1e-10  # Relative width of a bracket that is closed; chosen.
# Largest uncertainty of a time value, as a share of it and of what it lacks of its largest, at which the
# volatility's is proportional to it; chosen.
SMALL_SHARE = 0.1


# Prices some of the options, at volatilities, to tolerances, with or without vega; NaN where it does not serve one.
Pricer: TypeAlias = Callable[[NDArray[np.intp], Vector, Vector, bool], Prices]


@dataclass(frozen=True, slots=True, eq=False)
class FoundVolatilities:
    """The result of the search; every field has shape (n,).

    Parameters
    ----------
    status : int array
        OK and its companions above; NOT_SERVED where the pricer did not serve the option.
    volatility, price, european, error : Vector
        NaN unless OK; the last three are the pricer's at the volatility.
    volatility_error : Vector
        Estimated absolute error of the volatility, NaN unless OK.
    pricings : int array
    method : object array of str
        The pricer's of the last price; "none" unless OK.
    price_bound : Vector
        The price that the one to be met is below or not below, or that it equals; NaN where no bound settles it.
    """

    status: NDArray[np.int8]
    volatility: Vector
    price: Vector
    european: Vector
    error: Vector
    volatility_error: Vector
    pricings: NDArray[np.int64]
    method: NDArray[np.object_]
    price_bound: Vector

    def store(self, rows: NDArray[np.intp], part: FoundVolatilities) -> None:
        """Write what was found elsewhere into some of the rows."""
        for name in FoundVolatilities.__slots__:
            getattr(self, name)[rows] = getattr(part, name)


def nothing_found(count: int, status: int) -> FoundVolatilities:
    """Return the result of `count` rows for which no volatility has been found yet."""
    volatility, price, european, error, volatility_error, price_bound = np.full((6, count), np.nan)
    return FoundVolatilities(
        status=np.full(count, status, dtype=np.int8),
        volatility=volatility,
        price=price,
        european=european,
        error=error,
        volatility_error=volatility_error,
        pricings=np.zeros(count, dtype=np.int64),
        method=np.full(count, "none", dtype=object),
        price_bound=price_bound,
    )


def why_none(status: ImpliedStatus, price: float, bound: float) -> str:
    """Return why a price has no volatility, in words with the bound; nothing where no bound settles it.

    Examples
    --------
    >>> why_none("below_lower_bound", 10.0, 12.52)
    'the price must be at least 12.52, what the option is worth at volatility 0; it is 10'
    >>> why_none("above_upper_bound", 200.0, 100.0)
    'the price must be below 100, what the option is worth at the largest volatility; it is 200'
    """
    if math.isnan(bound):
        return ""
    worth = {
        "below_lower_bound": f"at least {bound:.10g}, what the option is worth at volatility 0",
        "above_upper_bound": f"below {bound:.10g}, what the option is worth at the largest volatility",
        "not_identifiable": f"above {bound:.10g}, what the option is worth at a whole interval of volatilities from 0",
    }
    return f"the price must be {worth[status]}; it is {price:.10g}"


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Where the search stands; every field has shape (n,).

    `here` is the volatility to be priced next, between `low` and `high`; `slope` is dy/dsigma, `before` and `y_before`
    are the last point of the stage, `goal` is y of the target.
    """

    here: Vector
    low: Vector
    high: Vector
    slope: Vector
    vega: Vector
    before: Vector
    y_before: Vector
    goal: Vector
    coarse: Vector
    fine: Vector
    is_fine: BoolVector


def search(targets: Targets, price_at: Pricer) -> FoundVolatilities:
    """Find the volatilities, 0 to 15, at which the prices are met to the tolerance.

    Each price is the pricer's to a quarter of the tolerance, 1e-8 at best, and met within half the tolerance, or a
    twentieth of the time value where that is less and more than the price's own error. A price whose own error is more
    than ten tolerances is not believed.

    Parameters
    ----------
    targets : Targets
    price_at : Pricer
        Prices a value that does not fall with the volatility.
    """
    with np.errstate(all="ignore"):
        found = _settled_by_bounds(targets)
        coordinate = choose_coordinate(targets)
        state = _start(targets, coordinate)
        for _ in range(MOST_PRICINGS):
            rows = np.flatnonzero(found.status == OPEN)
            if rows.size == 0:
                break
            is_fine = state.is_fine[rows]
            for part, tolerances in ((rows[~is_fine], state.coarse), (rows[is_fine], state.fine)):
                if part.size:
                    tolerance, with_vega = tolerances[part], tolerances is state.coarse
                    prices = price_at(part, state.here[part], tolerance, with_vega)
                    _advance(targets, coordinate, found, state, part, prices, tolerance)
        found.status[found.status == OPEN] = NO_CONVERGENCE
    return found


def _settled_by_bounds(targets: Targets) -> FoundVolatilities:
    """Return the statuses that the bounds settle."""
    found = nothing_found(targets.price.size, OPEN)
    rounding = ROUNDING * (targets.spot + targets.strike)
    allowed = np.maximum(targets.tolerance * targets.strike, rounding)
    found.status[targets.price >= targets.bounds.upper - rounding] = ABOVE
    found.status[targets.price <= targets.bounds.lower + rounding] = NOT_IDENTIFIABLE
    found.status[targets.price < targets.bounds.lower - allowed] = BELOW
    settled = np.flatnonzero(found.status != OPEN)
    above = found.status[settled] == ABOVE
    found.price_bound[settled] = np.where(above, targets.bounds.upper[settled], targets.bounds.lower[settled])
    return found


def _start(targets: Targets, coordinate: Coordinate) -> _State:
    count = targets.price.size
    goal, _ = coordinate.of(np.arange(count), targets.share(np.arange(count), targets.price))
    time_value = (targets.price - targets.bounds.lower) / targets.strike
    fine = np.maximum(FINE_SHARE * targets.tolerance, TOLERANCE.least)
    coarse = np.minimum(np.maximum(COARSE_SHARE * time_value, COARSE_GAIN * fine), COARSE)
    slope = np.where(coordinate.is_root, np.nan, np.sqrt(targets.expiry))  # exact for a European option
    vega, before, y_before = np.full((3, count), np.nan)
    return _State(
        here=np.minimum(first_volatility(targets, coordinate, goal), VOLATILITY.most),
        low=np.zeros(count),
        high=np.full(count, np.inf),
        slope=slope,
        vega=vega,
        before=before,
        y_before=y_before,
        goal=goal,
        coarse=np.where(coarse < COARSE_GAIN * fine, fine, coarse),
        fine=fine,
        is_fine=np.zeros(count, dtype=bool),
    )


def _advance(
    targets: Targets,
    coordinate: Coordinate,
    found: FoundVolatilities,
    state: _State,
    rows: NDArray[np.intp],
    prices: Prices,
    tolerance: Vector,
) -> None:
    """Take in one price of each of `rows`, all of them coarse or all fine: settle, or choose where to go next."""
    here, gap = state.here[rows], prices.value - targets.price[rows]
    found.pricings[rows] += 1
    state.low[rows] = np.where(gap < 0.0, here, state.low[rows])
    state.high[rows] = np.where(gap < 0.0, state.high[rows], here)
    low, high = state.low[rows], state.high[rows]
    narrow = (high < math.inf) & (high - low <= NARROWEST_BRACKET * high)
    final = tolerance <= state.fine[rows]
    found.status[rows] = status = _status(targets, rows, prices, here, gap, narrow, final, tolerance)
    share = targets.share(rows, prices.value)
    y, by_share = coordinate.of(rows, share)
    _learn(targets, state, rows, prices, y, by_share)
    above = np.flatnonzero(status == ABOVE)
    found.price_bound[rows[above]] = prices.value[above]
    settled = np.flatnonzero(status == OK)
    if settled.size:
        done = rows[settled]
        found.volatility[done] = here[settled]
        found.price[done] = prices.value[settled]
        found.european[done] = prices.european[settled]
        found.error[done] = prices.error[settled]
        found.method[done] = prices.method[settled]
        uncertain = (prices.error + np.abs(gap))[settled] / targets.span(done)
        change = _changes(coordinate, done, share[settled], y[settled], by_share[settled], uncertain)
        below, above = change / state.slope[done]
        found.volatility_error[done] = np.maximum(
            np.minimum(below, here[settled]), np.minimum(above, VOLATILITY.most - here[settled])
        )
    state.here[rows] = _next(found, state, rows, y, gap)
    near = np.abs(gap) <= COARSE_REACH * tolerance * targets.strike[rows]
    refined = rows[~final & (narrow | near)]
    state.is_fine[refined] = True
    # What coarse prices say of the bracket need not hold, and with fine ones they make no secant.
    state.low[refined], state.high[refined], state.before[refined] = 0.0, np.inf, np.nan


def _changes(
    coordinate: Coordinate, rows: NDArray[np.intp], share: Vector, y: Vector, by_share: Vector, by: Vector
) -> NDArray[np.float64]:
    """Return how far y falls and rises as the share of the time value does by so much, shape (2, n).

    A time value that may be none is one of any smaller volatility: the fall is infinite, as is the rise to the largest.
    """
    changes = np.tile(by * by_share, (2, 1))
    large = np.flatnonzero(~(by <= SMALL_SHARE * np.minimum(share, 1.0 - share)))
    if large.size:
        ends = share[large] - by[large], share[large] + by[large]
        lowest, highest = (coordinate.of(rows[large], end)[0] for end in ends)
        changes[0, large] = np.where(ends[0] > 0.0, y[large] - lowest, np.inf)
        changes[1, large] = np.where(ends[1] < 1.0, highest - y[large], np.inf)
    return changes


def _status(
    targets: Targets,
    rows: NDArray[np.intp],
    prices: Prices,
    here: Vector,
    gap: Vector,
    narrow: BoolVector,
    final: BoolVector,
    tolerance: Vector,
) -> NDArray[np.int8]:
    """Return what becomes of `rows`; `final` tells whose prices are fine, `narrow` whose bracket is closed."""
    strike = targets.strike[rows]
    most = GAP_SHARE * targets.tolerance[rows] * strike
    # Chasing a small time value ends where the price's own error begins.
    time_value = targets.price[rows] - targets.bounds.lower[rows]
    wanted = np.minimum(most, np.maximum(GAP_OF_TIME_VALUE * time_value, prices.error))
    reached = np.abs(gap) <= np.where(narrow, most, wanted)
    sure = prices.error <= LARGEST_ERROR * targets.tolerance[rows] * strike
    status = np.full(rows.size, OPEN, dtype=np.int8)
    status[final & (narrow | reached)] = NO_CONVERGENCE
    status[final & reached & sure] = OK
    reach = np.where(final, most, COARSE_REACH * tolerance * strike)
    status[(here >= VOLATILITY.most) & (gap < -reach)] = ABOVE
    status[np.isnan(gap)] = NOT_SERVED
    return status


def _next(found: FoundVolatilities, state: _State, rows: NDArray[np.intp], y: Vector, gap: Vector) -> Vector:
    """Return the next volatilities: Newton's in y, else Newton's in the price, else inside the bracket."""
    here, low, high = state.here[rows], state.low[rows], state.high[rows]
    widened = np.where(gap < 0.0, LARGEST_FACTOR, 1.0 / LARGEST_FACTOR) * here
    bracketed = (low > 0.0) & (high < math.inf)
    there = np.where(bracketed, np.sqrt(low * high), widened)
    slow = (found.pricings[rows] >= PATIENCE) & (found.pricings[rows] % 2 == 0)
    for step in (-gap / state.vega[rows], (state.goal[rows] - y) / state.slope[rows]):
        newton = here + step
        inside = (newton > low) & (newton < high) & (np.abs(np.log(newton / here)) <= LARGEST_NEWTON)
        there = np.where(inside & (y > 0.0) & ~slow, newton, there)
    next_volatility: Vector = np.minimum(there, VOLATILITY.most)
    return next_volatility


def _learn(
    targets: Targets, state: _State, rows: NDArray[np.intp], prices: Prices, y: Vector, by_share: Vector
) -> None:
    """Take the slopes from the vega, or from the last two prices of the stage, where they are of use."""
    here, slope = state.here[rows], state.slope[rows]
    slope = np.where(np.isnan(slope), FIRST_SLOPE * y / here, slope)
    secant = (y - state.y_before[rows]) / (here - state.before[rows])
    for better in (secant, prices.vega / targets.span(rows) * by_share):
        slope = np.where(np.isfinite(better) & (better > 0.0), better, slope)
    state.slope[rows] = slope
    state.vega[rows] = np.where(prices.vega > 0.0, prices.vega, state.vega[rows])
    state.before[rows], state.y_before[rows] = here, y
