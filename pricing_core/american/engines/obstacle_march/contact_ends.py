"""Where contact sets of the march in NumPy end over time, and exercise boundaries now."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.exercise_region import earning_region
from pricing_core.american.engines.obstacle_march.boundaries import (
    Piece,
    Traces,
    ends_of,
    first_places,
)
from pricing_core.american.engines.obstacle_march.contract_problem import GONE, contract_problem
from pricing_core.obstacle import ObstacleSolution, solve
from pricing_core.obstacle.march import March, SegmentMarch
from pricing_core.obstacle.profile import Intervals
from pricing_core.obstacle.solution import held_before

GAP = 2.0  # Cells between two contact sets, or one and an end of the interval, that no grid resolves; chosen.
# Tolerance of a solve that is asked where the boundary is, in strikes, where the price's own has not met it; chosen.
ELSEWHERE = 1e-4


def coefficient_jumps(book: Book) -> tuple[float, ...]:
    """Return the ends of segments at which a curve jumps: from there on a boundary goes as the root of time."""
    names = ("rate", "dividend_yield", "volatility", "exercisable")
    return tuple(
        before.end
        for before, after in pairwise(book.segments_of())
        if any(getattr(before, name) != getattr(after, name) for name in names)
    )


def exercise_begins(book: Book) -> tuple[float, ...]:
    """Return the ends of segments before which exercise earns somewhere, and after which it does so nowhere.

    There a contact set begins, far from all nodes first and soon over many of them in one step: steps begin anew.
    """
    is_put = book.is_put.item()
    return tuple(
        before.end
        for before, after in pairwise(book.segments_of())
        if _earns(before, is_put=is_put) and not _earns(after, is_put=is_put)
    )


def _earns(segment: Segment, *, is_put: bool) -> bool:
    region = earning_region(segment, is_put=is_put)
    return region.lower <= region.upper


def traces_of(book: Book, found: ObstacleSolution, first: int | None = None) -> Traces:
    """Trace the boundaries of a solution whose problem has segments that end where coefficients jump.

    With `first` only through so many of its segments from now on.
    """
    fine, coarse = (_pieces(book, march, first) for march in (found.march, found.coarse))
    return Traces(book, fine, coarse)


def boundary_now(book: Book, found: ObstacleSolution, request: Request) -> tuple[float, float]:
    """Return the exercise boundary now, of two the one nearer the strike, and its error, money; NaN without one."""
    if not book.segments.exercisable.item(0) or found.march is None:
        return math.nan, math.nan
    near, error = _near_now(book, found)
    left, right = found.march.grid.x[[0, -1]].tolist()
    # Where no boundary was found there may be a contact set next to an end of the interval.
    unresolved = bool(found.march.now.contacts[0])
    for place in first_places(book):
        if math.isnan(near) and (unresolved or not left < place < right) and not request.is_interrupted():
            there = book.diffusing_at(book.strike * math.exp(place))
            problem = contract_problem(there, exercise_begins(there))
            other = solve(problem, place, ELSEWHERE, interrupt=request.interrupt)
            near, error = _near_now(book, other)
    return near, error


def _near_now(book: Book, found: ObstacleSolution) -> tuple[float, float]:
    ends = traces_of(book, found, first=1).at(np.zeros(1))
    return ends.near.item(), ends.error.item()


def boundary_place(march: March, *, is_put: bool) -> float:
    """Return where exercise begins now, in x, of two ends the one nearer the strike; NaN without one."""
    return _ends(march, march.now.contacts[0], is_put=is_put)[0]


def _pieces(book: Book, march: March | None, first: int | None) -> tuple[Piece, ...]:
    """Return the boundaries between the ends of segments, in the order of time, of the first or of all."""
    if march is None:
        return ()
    later = [None, *march.parts[:-1]]
    in_time = list(zip(march.parts, later, strict=True))[::-1]
    return tuple(_piece(book, march, *pair) for pair in in_time[:first])


def _piece(book: Book, march: March, part: SegmentMarch, later: SegmentMarch | None) -> Piece:
    is_put, segments = book.is_put.item(), book.segments_of()
    obstacle, start, end = march.problem.lower, part.segment.start, part.segment.end
    times, known = np.zeros(0), np.zeros((0, 3))
    if part.segment.acting[0] is not None:
        instants = part.instants[1:]
        times = np.array([instant.t for instant in instants])
        known = np.array([_ends(march, march.profile(one).contacts[0], is_put=is_put) for one in instants])
    # Rounding may hold a value of 0, which is not exercised.
    segment = next((one for one in segments if end <= one.end), segments[-1])
    kink = math.log(max(1.0 - segment.escrow_at(end) / book.strike.item(), GONE))
    held = () if obstacle is None else held_before(part, obstacle, 1.0)
    pays = [pair for pair in held if (pair[0] < kink if is_put else pair[1] > kink)]
    at_end = (*_two(tuple(pays), is_put=is_put), 0.0)
    if not pays and later is not None and segment.due == 0.0 and segment.fraction == 0.0:
        at_end = _ends(march, later.first.contacts[0], is_put=is_put)  # the value goes on as it is
    return Piece.of(book, (start, end), times, known, at_end)


def _ends(march: March, contacts: Intervals, *, is_put: bool) -> tuple[float, float, float]:
    """Return the ends of a contact set, in x, and how far the one nearer the strike may move unseen.

    This is a cell where it is at a node, as where a step is too short for the grid.
    """
    resolved = _resolved(march, contacts)
    near, far = _two(tuple((_place(march, a), _place(march, b)) for a, b in resolved), is_put=is_put)
    if math.isnan(near):
        return near, far, 0.0
    index = (max(resolved)[1] if is_put else min(resolved)[0]) // 1.0
    left, right = march.grid.place(np.array([index, index + 1.0])).tolist()
    return near, far, right - left if near == left else 0.0


def _resolved(march: March, contacts: Intervals) -> Intervals:
    """Return intervals of nodes joined where less than `GAP` cells lie between two.

    A node that the end of a contact set passes within a step leaves such a gap. What comes as near to an end of the
    interval goes on beyond it; what lies next to it as a whole, where the end's rule holds V as the obstacle does, says
    nothing of where the contact set ends and is left out.
    """
    last = march.grid.x.size - 1
    joined: list[tuple[float, float]] = []
    for left, right in contacts:
        begins = joined.pop()[0] if joined and left - joined[-1][1] < GAP else left
        joined.append((begins, right))
    return tuple(
        (-math.inf if left < GAP else left, math.inf if right > last - GAP else right)
        for left, right in joined
        if right >= GAP and left <= last - GAP
    )


def _place(march: March, edge: float) -> float:
    return edge if math.isinf(edge) else float(march.grid.place(np.array([edge]))[0])


def _two(intervals: Intervals, *, is_put: bool) -> tuple[float, float]:
    """Return the end nearer the strike and the other one of the contact set next to the strike; NaN without one."""
    if not intervals:
        return math.nan, math.nan
    return ends_of(*(max(intervals) if is_put else min(intervals)), is_put=is_put)
