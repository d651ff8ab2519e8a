"""The early exercise boundary as a function of time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contracts.contract import Option, check_kind, real_number
from pricing_core.american.contracts.market import FlatMarket, Market
from pricing_core.american.contracts.schedule import without_events
from pricing_core.american.contracts.tolerances import (
    BOUNDARY_ACCURACY,
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
)
from pricing_core.american.events.scheduled_boundary import (
    event_times,
    schedule_of_boundary,
    scheduled_boundary,
)
from pricing_core.american.flat.engine import coarsest_resolution, make_solver
from pricing_core.american.flat.exercise_region import ExerciseRegion, region_at_expiry
from pricing_core.american.flat.limits import is_deterministic
from pricing_core.american.flat.premium import Puts, solve_boundaries
from pricing_core.american.flat.resolution import Solution
from pricing_core.american.flat.spot_values import region_of
from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError, NumericalError

DEFAULT_POINTS = 101
FEWEST_POINTS, JUST_AFTER = 12, 1e-6  # between two events, and of the time between them
INTERRUPTED = "interrupted before the boundary was found: allow more time"
DOUBLINGS = 4  # of the coarsest resolution; one less for tolerances above 1e-4
NEIGHBOURS = 4  # nodes of the local interpolation in sqrt(tau)


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
        Of `boundary`, in money; 0 at expiry, NaN where the general path found it.
    """

    time: Vector
    time_to_expiry: Vector
    boundary: Vector
    other_boundary: Vector | None
    error_estimate: Vector


def exercise_boundary(
    option: Option,
    market: Market,
    times: ArrayLike | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    interrupt: Callable[[], bool] | None = None,
) -> ExerciseBoundary:
    """Return the exercise boundary: within 1e-4 of itself at the default tolerance, 1e-5 at the smallest.

    Every time has a march of its own, scaled to the root of the time to expiry: the accuracy is the same close to
    expiry. Where there are two boundaries, or the march does not serve, the general path is taken: 1e-3 for time to
    expiry >= expiry/10, and ten times less accuracy at expiry/100.

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
        Asked before every time step.

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
    tolerance = real_number("tolerance", tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE)
    plain = without_events(option, market)
    if plain is None:
        return _with_events(option, market, times, tolerance, interrupt)
    option, flat = plain
    chosen = _default_times(option) if times is None else _checked_times(option, times)
    tau = np.maximum(option.expiry - chosen, 0.0)
    flat = replace(flat, spot=option.strike)  # the boundary does not depend on the spot
    limit = region_at_expiry(option, flat)
    error = np.full(tau.size, math.nan)
    if option.exercise == "european":
        ends = np.full((tau.size, 2), math.nan)
    elif limit.lower > limit.upper or option.expiry == 0.0 or is_deterministic(option, flat, tolerance):
        ends = np.tile(limit.boundaries(option), (tau.size, 1))
    else:
        if interrupt is not None and interrupt():
            raise NumericalError(INTERRUPTED)
        ends = np.full((tau.size, 2), math.nan)
        if math.isnan(limit.boundaries(option)[1]):
            ends[:, 0], error = _march(option, flat, tau, limit, tolerance)
        left = np.flatnonzero(np.isnan(ends[:, 0]))  # not served by the march
        if left.size:
            ends[left] = _solve(option, flat, tau[left], limit, tolerance, interrupt)
    other = None if math.isnan(limit.boundaries(option)[1]) else ends[:, 1]
    return ExerciseBoundary(chosen, tau, ends[:, 0], other, error)


def _with_events(
    option: Option,
    market: Market,
    times: ArrayLike | None,
    tolerance: float,
    interrupt: Callable[[], bool] | None,
) -> ExerciseBoundary:
    schedule = schedule_of_boundary(option, market)
    if times is not None:
        chosen = _checked_times(option, times)
    elif option.exercise == "bermudan":  # there is none between
        chosen = np.unique(np.concatenate([[0.0], event_times(schedule)]))
    else:
        chosen = _times_around(event_times(schedule))
    if interrupt is not None and interrupt():
        raise NumericalError(INTERRUPTED)
    ends, error = scheduled_boundary(option, schedule, chosen, tolerance, interrupt)
    other = None if np.isnan(ends[:, 1]).all() else ends[:, 1]
    return ExerciseBoundary(chosen, option.expiry - chosen, ends[:, 0], other, error)


def _march(
    option: Option, market: FlatMarket, tau: Vector, limit: ExerciseRegion, tolerance: float
) -> tuple[Vector, Vector]:
    """Return the boundary and its error in money; NaN at the times that the march does not serve."""
    later = tau > 0.0
    years = tau[later]
    rate, dividend_yield = market.rate, market.dividend_yield
    if not option.is_put:  # a put with rate and yield exchanged, and the boundary mirrored at the strike
        rate, dividend_yield = dividend_yield, rate
    puts = Puts(
        np.zeros(years.size), rate * years, dividend_yield * years, market.volatility * np.sqrt(years)
    )
    found, relative, settled = solve_boundaries(puts, BOUNDARY_ACCURACY * math.sqrt(tolerance))
    boundary, error = np.full(tau.size, limit.boundaries(option)[0]), np.zeros(tau.size)
    boundary[later] = option.strike * np.exp(np.where(settled, found if option.is_put else -found, math.nan))
    # Monotone in time, as the boundary is (Jaillet, Lamberton, Lapeyre 1990): tau decreases along the array.
    running, known = (np.fmin if option.is_put else np.fmax), ~np.isnan(boundary)
    boundary[known] = running.accumulate(boundary[::-1])[::-1][known]
    error[later] = relative * boundary[later]
    return boundary, error


def _solve(
    option: Option,
    market: FlatMarket,
    tau: Vector,
    limit: ExerciseRegion,
    tolerance: float,
    interrupt: Callable[[], bool] | None,
) -> Matrix:
    """Return (near, far) boundary in money at times to expiry tau, shape (m, 2)."""
    resolution = coarsest_resolution(option, market, "sdirk2")
    for _ in range(DOUBLINGS if tolerance < 1e-4 else DOUBLINGS - 1):
        resolution = resolution.refined()
    ends = np.full((tau.size, 2), math.nan)
    far_limit = limit.boundaries(option)[1]
    for spot in (option.strike, far_limit):
        if math.isnan(spot) or not np.isnan(ends[:, 1]).all():
            continue  # there is one boundary only, or both were found on one domain
        seen_from = replace(market, spot=spot)
        solver = make_solver(option, seen_from, tolerance, resolution, interrupt=interrupt)
        level = solver.solve(resolution)
        if level is None:
            raise NumericalError(INTERRUPTED)
        found = boundaries_at(level.solution, tau, limit)
        ends = np.where(np.isnan(ends), found, ends)
    return ends


def boundaries_at(solution: Solution, tau: Vector, limit: ExerciseRegion) -> Matrix:
    """Return the (near, far) boundary that this solve saw, shape (m, 2), NaN where it saw none.

    The solve's own values are made monotone in time, as the boundary is (Jaillet, Lamberton, Lapeyre 1990), and
    interpolated by cubics in sqrt(tau) between their neighbours.
    """
    option = solution.form.option
    count = solution.tau.size
    ends = np.array([region_of(solution, k).boundaries(option) for k in range(1, count)])
    root = np.sqrt(solution.tau)
    result = np.full((tau.size, 2), math.nan)
    for column, start in enumerate(limit.boundaries(option)):
        exists = np.flatnonzero(~np.isnan(ends[:, column]))
        if exists.size and exists[0] == 0:
            known = exists[-1] + 1  # the region, once gone, does not come back
            falls = option.is_put == (column == 0)
            running = np.minimum if falls else np.maximum
            values = running.accumulate(np.concatenate([[start], ends[:known, column]]))
            inside = tau <= solution.tau[known]
            result[inside, column] = _interpolate(root[: known + 1], values, np.sqrt(tau[inside]))
    return result


def _interpolate(nodes: Vector, values: Vector, wanted: Vector) -> Vector:
    """Return the cubic through the four nearest nodes, between its two neighbours; linear next to expiry."""
    result = np.interp(wanted, nodes, values)
    if nodes.size <= NEIGHBOURS:
        return result
    # The first nodes are left out: the boundary leaves its limit with infinite slope, times a logarithm.
    for i in np.flatnonzero(wanted >= nodes[1]):
        first = min(max(int(np.searchsorted(nodes, wanted[i])) - NEIGHBOURS // 2, 1), nodes.size - NEIGHBOURS)
        local = nodes[first : first + NEIGHBOURS] - wanted[i]
        scale = local[-1] - local[0]
        powers = np.vander(local / scale, increasing=True)
        cubic = np.linalg.solve(powers, values[first : first + NEIGHBOURS])[0]
        bracket = values[max(0, int(np.searchsorted(nodes, wanted[i])) - 1) :][:2]
        result[i] = min(max(cubic, bracket.min()), bracket.max())
    return result


def _default_times(option: Option) -> Vector:
    if option.expiry == 0.0:
        return np.zeros(1)
    return option.expiry * (1.0 - np.linspace(1.0, 0.0, DEFAULT_POINTS) ** 2)


def _times_around(events: Vector) -> Vector:
    """Return 0, the events' times, the last of which is the expiry, and others: close before, and one just after."""
    count = max(FEWEST_POINTS, DEFAULT_POINTS // events.size)
    inside = 1.0 - np.linspace(1.0, 0.0, count) ** 2
    inside[0] = JUST_AFTER
    starts = np.concatenate([[0.0], events[:-1]])
    return np.unique(np.concatenate([[0.0], events, (starts + np.outer(inside, events - starts)).ravel()]))


def _checked_times(option: Option, times: ArrayLike) -> Vector:
    chosen = as_vector("times", times)
    if np.any(chosen < 0.0) or np.any(chosen > option.expiry) or np.any(np.diff(chosen) <= 0.0):
        raise InvalidInputError("times", times, "increasing, from 0 to the expiry")
    return chosen
