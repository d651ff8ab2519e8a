"""Schedules from expiry to now, one at a time, in NumPy: the reference of the compiled kernel."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.collocation_twin.boundary import (
    RUNGS,
    Boundary,
    Climb,
    Start,
    shifted_start,
    solve_boundary,
)
from pricing_core.collocation_twin.flow import Flow
from pricing_core.collocation_twin.held import Held
from pricing_core.collocation_twin.panels import Feature, Fineness
from pricing_core.collocation_twin.profile import Profile
from pricing_core.collocation_twin.start import Outset, UnservedError, find_start
from pricing_core.collocation_twin.stretch import Stretch
from pricing_core.collocation_twin.transfer import Transferred, at_expiry, before_event


class Level(NamedTuple):
    """How finely a schedule is solved.

    Parameters
    ----------
    panel_points : int
        Gauss points of a panel.
    kernel, feature : float
        Widest panel, in spreads and in distances to a place where the value bends.
    reach : float
        Half the width of the interval of x, in standard deviations of ln(spot) at expiry.
    """

    panel_points: int
    kernel: float
    feature: float
    reach: float


LEVELS = (
    Level(5, 2.0, 1.5, 4.6),
    Level(5, 2.0, 1.4, 4.9),
    Level(8, 2.0, 1.3, 5.8),
    Level(8, 1.6, 1.1, 6.4),
    Level(10, 1.6, 1.1, 6.9),
    Level(10, 1.4, 1.0, 7.3),
    Level(12, 1.4, 1.0, 7.6),
)
FINE_KERNEL = 0.4  # spreads: widest panel where the contact set begins at nodes
CHECKED = 0.5  # spreads outside the contact set: where value and payoff are compared
LARGEST_VIOLATION = 1e-4  # strikes, by which holding may be worth less than exercise outside the contact set
BOUNDARY_REACH = (
    2.5  # deviations at expiry within which boundaries are looked for: the one now, and any asked for
)
MOST_CUTS = 4  # of one stretch
MOST_SPREADS = 600.0  # of what is cut off: a wider interval needs too many panels
NEXT_TO_EVENT = 0.1  # of a stretch: where it is cut whose boundary no degree follows closely enough
MOST_STALLS = (
    2  # where so many rungs in a row fail or bring nothing, it is cut without trying any further one
)
RELEVANT = 5.0  # standard deviations of ln(spot) at a stretch's end within which its contact set matters
LEAST_FORWARD = 0.1  # of a spot that a dividend would take to zero or less
# Of what is left of the tolerance, for one boundary; and of the tolerance, at the least for all of them together.
SHARE, LEAST_SHARE = 0.5, 0.2
RESULTS = 6  # value, slope, second derivative by x; boundary now; residual; error


class Query(NamedTuple):
    """Times from now at which the boundary is wanted, increasing, and the answers."""

    times: Vector
    found: Vector


def solve_schedules(
    sign: Vector,
    x: Vector,
    first: NDArray[np.int64],
    stretches: Matrix,
    level: NDArray[np.int64],
    tolerance: Vector,
    times: Vector,
    first_time: NDArray[np.int64],
    threads: int,
) -> tuple[Matrix, Vector, BoolVector]:
    """Solve every schedule at its level.

    Parameters
    ----------
    sign : Vector, shape (n,)
        1 for a put, -1 for a call.
    x : Vector, shape (n,)
        ln(S/K) now.
    first : int array, shape (n + 1,)
        The first stretch of each schedule, and the number of stretches.
    stretches : Matrix, shape (m, 9)
        duration, rate, yield, volatility, exercisable, exercise at the end, fraction, amount, escrow; in the order of
        time, in years and strikes.
    level : int array, shape (n,)
        Of `LEVELS`.
    tolerance : Vector, shape (n,)
        Strikes, that the value may change by from one degree of a boundary to the next; 0 for the level's own degree.
    times : Vector, shape (t,)
        Years from now at which boundaries are wanted, increasing for each schedule.
    first_time : int array, shape (n + 1,)
        The first time of each schedule, and the number of times.
    threads : int
        Not used here.

    Returns
    -------
    Matrix, shape (6, n)
        Value in strikes, its first and second derivative by x, the boundary ln(S*/K) now (NaN without one), the
        largest violation of complementarity that was seen, in strikes, and what the value may be off by for the
        boundaries' degrees (0 at tolerance 0).
    Vector, shape (t,)
        Boundaries at the times, just before what happens then; NaN where there is none.
    bool array, shape (n,)
        Whether every boundary was found; nothing in the other columns may be used.
    """
    del threads
    results, found = np.full((RESULTS, x.size), np.nan), np.full(times.size, np.nan)
    settled = np.zeros(x.size, dtype=bool)
    for row in range(x.size):
        parts = [_stretch(sign[row], numbers) for numbers in stretches[first[row] : first[row + 1]].tolist()]
        wanted = slice(int(first_time[row]), int(first_time[row + 1]))
        query = Query(times[wanted], found[wanted])
        with np.errstate(all="ignore"):
            try:
                settled[row] = _solve(
                    parts, float(x[row]), int(level[row]), float(tolerance[row]), query, results[:, row]
                )
            except (UnservedError, ArithmeticError, np.linalg.LinAlgError):
                settled[row] = False
    return results, found, settled


def _stretch(sign: float, numbers: list[float]) -> Stretch:
    duration, rate, dividend, volatility, exercisable, at_end, fraction, amount, escrow = numbers
    flow = Flow(rate, dividend, volatility)
    return Stretch(float(sign), flow, duration, exercisable != 0.0, at_end != 0.0, fraction, amount, escrow)


def _solve(
    parts: list[Stretch], x: float, number: int, tolerance: float, query: Query, result: Vector
) -> bool:
    """Fill the result; return whether all boundaries were found."""
    level = LEVELS[number]
    deviation, variance, forward = _forecast(parts, x)
    exercised = any(part.exercisable or part.exercise_at_end for part in parts)
    held: Held | None = None
    features: tuple[Feature, ...] = ()
    end, residual, error = math.fsum(part.duration for part in parts), 0.0, 0.0
    least = LEAST_SHARE * tolerance / len(parts)
    for k in reversed(range(len(parts))):
        waiting = [parts[k]]
        cuts = 0
        centre, left = forward[k], variance[k]
        while waiting:
            part = waiting.pop()
            if part.exercisable and part.is_two_sided():
                return False
            here = math.sqrt(variance[k])
            ends = _interval(level, part, forward[k], (here, deviation), exercised)
            spread = part.spread
            fineness = Fineness(spread, level.panel_points, level.kernel, level.feature)
            before = at_expiry(part) if held is None else before_event(held, part, features, ends, fineness)
            nodes_only = held is not None and held.boundary is None
            asked = BOUNDARY_REACH * deviation if query.times.size else 0.0
            relevant = _relevant(before, part, forward[k], max(asked, RELEVANT * here))
            outset = Outset(before.profile, part, before.contact, relevant, before.features, nodes_only)
            if nodes_only and outset.begins():
                assert held is not None
                before = before_event(held, part, features, ends, fineness._replace(kernel=FINE_KERNEL))
                outset = replace(outset, profile=before.profile, features=before.features)
            start, split = find_start(outset)
            if start is not None and split > 0.0 and cuts < MOST_CUTS:
                cuts += 1
                waiting += part.parted(split)  # the later one needs panels of its own width
                continue
            begins = centre - (part.flow.rate - part.flow.dividend) * part.duration, left - spread**2
            may_cut = cuts < MOST_CUTS and _is_narrow(ends, spread)
            climb = Climb(
                len(RUNGS) - 1 if tolerance > 0.0 else number,
                max(least, SHARE * ((1.0 - LEAST_SHARE) * tolerance - error)) if tolerance > 0.0 else None,
                tolerance,
                MOST_STALLS if may_cut else len(RUNGS),
                begins[0],
                math.sqrt(max(begins[1], 0.0)),
            )
            boundary = None if start is None else _find_boundary(before.profile, part, start, climb)
            if may_cut and not _is_close(boundary, climb):
                cuts += 1
                waiting += part.parted(NEXT_TO_EVENT * part.duration)
                continue
            centre, left = begins
            held = _held(before, part, boundary)
            if boundary is not None:
                residual, error = max(residual, boundary.violation), error + boundary.error
            _answer(query, end, part, before.contact, held)
            end -= part.duration
            features = _carried(before.features, part, held)
    assert held is not None
    result[:3] = held.value(np.array([x]))[:, 0]
    result[3:] = held.edge, residual, error
    return bool(np.all(np.isfinite(result[:3])))


def _forecast(parts: list[Stretch], x: float) -> tuple[float, Vector, Vector]:
    """Return the deviation of ln(spot) at expiry, and its variance and logarithm at each stretch's end."""
    variance, forward = np.empty(len(parts)), np.empty(len(parts))
    spread, place = 0.0, x
    for k, part in enumerate(parts):
        spread += part.flow.volatility**2 * part.duration
        place += (part.flow.rate - part.flow.dividend) * part.duration
        variance[k], forward[k] = spread, place
        spot = math.exp(place)
        left = max(spot * (1.0 - part.fraction) - part.amount, LEAST_FORWARD * spot)
        place += math.log(left / spot)
    return math.sqrt(spread), variance, forward


def _interval(
    level: Level, part: Stretch, forward: float, deviations: tuple[float, float], exercised: bool
) -> tuple[float, float]:
    """Return the interval of x that matters: where the spot may be then, and as far as a boundary may be."""
    here, at_expiry = deviations
    near = level.reach * here
    if not exercised:
        return forward - near, forward + near
    far = near + min(level.reach, BOUNDARY_REACH) * (at_expiry - here)
    below, above = (far, near) if part.sign > 0.0 else (near, far)
    return min(forward, 0.0) - below, max(forward, 0.0) + above


def _is_close(boundary: Boundary | None, climb: Climb) -> bool:
    return boundary is None or (boundary.is_found and not boundary.is_too_rough(climb))


def _is_narrow(ends: tuple[float, float], spread: float) -> bool:
    """Tell whether the interval is narrow enough for the panels of what would be cut off."""
    return ends[1] - ends[0] <= MOST_SPREADS * math.sqrt(NEXT_TO_EVENT) * spread


def _relevant(before: Transferred, part: Stretch, forward: float, reach: float) -> float:
    """Return the x beyond which, on the side of exercise, the contact set does not matter while it begins."""
    sign, spread = part.sign, part.spread
    furthest = min(sign * forward, 0.0) - reach
    bends = [sign * feature.place for feature in before.features if feature.scale == 0.0]
    bend = min((x for x in bends if x > furthest), default=0.0)
    return sign * min(furthest, bend - RELEVANT * spread)


def _held(before: Transferred, part: Stretch, boundary: Boundary | None) -> Held:
    """Return the value at the stretch's beginning.

    Raises
    ------
    UnservedError
        The boundary was not found, or something is worth less than exercise outside the contact set.
    """
    at_zero = before.at_zero * math.exp(-part.flow.rate * part.duration)
    if part.exercisable and part.sign > 0.0:
        at_zero = max(at_zero, part.strike(part.duration))
    held = Held(before.profile, part, boundary, at_zero)
    if boundary is not None:
        if not boundary.is_found:
            raise UnservedError
        _check_outside(held, boundary)
    return held


def _check_outside(held: Held, boundary: Boundary) -> None:
    """Refuse what is worth less than exercise outside the contact set: next to it, and where it has left.

    Raises
    ------
    UnservedError
    """
    part, start = held.stretch, boundary.start.place
    spread = part.spread
    places = [boundary.last + part.sign * CHECKED * spread]
    if part.sign * (start - boundary.last) > spread:
        places += [0.5 * (start + boundary.last), start]
    x = np.array(places)
    outside = held.continued(x)[0] - part.sign * (held.strike - np.exp(x))
    if np.any(outside < -LARGEST_VIOLATION):
        raise UnservedError


def _find_boundary(profile: Profile, part: Stretch, start: Start, climb: Climb) -> Boundary:
    """Return the boundary; where smooth pasting does not find it, the other equation is tried."""
    boundary = solve_boundary(profile, part, start, climb)
    if boundary.is_found or start.form not in ("plain", "root"):
        return boundary
    return solve_boundary(profile, part, shifted_start(profile, part, start.time, start.place), climb)


def _carried(features: tuple[Feature, ...], part: Stretch, held: Held) -> tuple[Feature, ...]:
    """Return the features at the stretch's beginning: moved by the drift and smoothed."""
    variance = part.flow.volatility**2 * part.duration
    shift = part.flow.drift * part.duration
    carried = tuple(Feature(f.place - shift, math.sqrt(f.scale**2 + variance)) for f in features)
    return carried if held.boundary is None else (*carried, Feature(held.edge, 0.0))


def _answer(query: Query, end: float, part: Stretch, contact: float, held: Held) -> None:
    """Fill in the boundaries at the times that fall on the stretch's end, or inside and on its beginning."""
    begin = end - part.duration
    for i, time in enumerate(query.times.tolist()):
        if abs(time - end) <= 1e-12 * max(end, 1.0):
            query.found[i] = contact if math.isfinite(contact) else math.nan
        elif begin - 1e-12 <= time < end and held.boundary is not None:
            query.found[i] = held.boundary.at(min(end - time, part.duration))
