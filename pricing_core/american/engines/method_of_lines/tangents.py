"""Derivatives by parameters, carried along with the value: with the contact set held fast they are linear problems.

The value is stationary in the exercise boundary, so that its derivative v_p solves v_p' = L v_p + L_p v where the
option is held, and is g_p where it is exercised: on the grid the same matrices as the value's, one more right-hand side
for each parameter and step. At an event they follow from the derivative of the event's own map.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.differences import plan_directions
from pricing_core.american.engines.method_of_lines.event_transfer import (
    EventValue,
    GridFunction,
    SlopeWeights,
    ValueFunction,
    dropped,
)
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.operators import difference_operators, raised_diffusion
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm, end_lines
from pricing_core.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """A parameter: the schedule with a little more and a little less of it.

    Parameters
    ----------
    kind : str
        The column of `Prices` that the derivative belongs to.
    entry : int
        The place in it.
    up, down : Schedule
        Cut like the schedule itself.
    step : float
        Half of what they differ by.
    """

    kind: str
    entry: int
    up: Schedule
    down: Schedule
    step: float

    @property
    def spot(self) -> float:
        """What the spot that diffuses changes by in units of the strike: escrowed dividends reduce it."""
        return (self.up.spot - self.down.spot) / (2.0 * self.step * self.up.strike)

    def change(self, number: int, of: Callable[[Segment], float]) -> float:
        """Return the derivative of a number of one segment."""
        return (of(self.up.segments[number]) - of(self.down.segments[number])) / (2.0 * self.step)


def directions_of(book: Book, *, extended: bool, only: str = "") -> tuple[Direction, ...]:
    """Return the parameters of a book of one contract; none where one of them asks for a further cut.

    Parameters
    ----------
    only : str
        The one kind that is wanted, if not all are.
    """
    return tuple(
        Direction(kind, entry, up.schedule(0), down.schedule(0), step)
        for kind, entry, up, down, step in plan_directions(book, extended=extended)
        if not only or kind == only
    )


@dataclass(frozen=True, slots=True, eq=False)
class Tangents:
    """The derivatives by P parameters at one time, in units of the strike.

    Parameters
    ----------
    values : Matrix, shape (P, N + 2)
    at_zero : Vector, shape (P,)
        At s = 0.
    """

    values: Matrix
    at_zero: Vector

    @classmethod
    def nothing(cls, parameters: int, nodes: int) -> "Tangents":
        """Return those of the payoff."""
        return cls(np.zeros((parameters, nodes)), np.zeros(parameters))

    def at_start(self, values: Matrix, form: SegmentForm, changes: Matrix, at_end: float) -> "Tangents":
        """Return those at the start of a segment: `values` at the nodes, and at s = 0 what the ends of it say.

        Parameters
        ----------
        changes : Matrix, shape (P, 3)
            Of `kernel_arguments`.
        at_end : float
            The value at s = 0 at the segment's end.
        """
        segment, duration = form.segment, form.segment.duration
        bond = math.exp(-segment.rate * duration)
        at_zero = bond * (self.at_zero - at_end * duration * changes[:, 0])
        exercised = float(form.obstacle(duration, np.zeros(1))[0])
        if segment.exercisable and exercised > at_end * bond:
            at_zero = -form.sign * bond * (changes[:, 2] - form.escrow * duration * changes[:, 0])
        if form.grid.nodes[0] == 0.0:
            values[:, 0] = at_zero
        return Tangents(values, at_zero)


def before_event(
    tangents: Tangents,
    after: ValueFunction,
    event: EventValue,
    segment: Segment,
    changes: Matrix,
    sign: float,
    strike: float,
    nodes: Vector,
) -> Tangents:
    """Return the derivatives just before the event at the end of `segment`, from those just after it.

    Parameters
    ----------
    changes : Matrix, shape (P, 2)
        The derivatives of the amount and of the escrow, in units of the strike.
    """
    by_amount, by_obstacle = changes[:, :1], -sign * changes[:, 1:]
    values, jumps = tangents.values, []
    held = dropped(after, segment, strike)
    if held is not after or by_amount.any():
        kept = 1.0 - segment.fraction
        ex = np.maximum(nodes * kept - segment.amount / strike, 0.0)
        weights = SlopeWeights.of(nodes)
        functions = zip(values, tangents.at_zero.tolist(), strict=True)
        moved = [GridFunction(nodes, row, weights.slopes(row), zero).value(ex) for row, zero in functions]
        slope = np.where(ex > 0.0, after.slope(ex), 0.0)
        values = np.array(moved).reshape(values.shape) - by_amount * slope
        if kept > 0.0:
            jumps = [(kink.place, -by_amount * kink.jump / kept) for kink in held.kinks]
    at_zero = tangents.at_zero
    if segment.exercise_at_end:
        inside = event.exercised
        jumps = [(place, jump) for place, jump in jumps if not event.region.contains(place)]
        for place in event.crossings:
            left = min(max(int(np.searchsorted(nodes, place, side="right")) - 1, 0), nodes.size - 2)
            free = left + 1 if inside[left] else left
            jumps.append(
                (place, (values[:, free : free + 1] - by_obstacle) * (1.0 if inside[left] else -1.0))
            )
        values = np.where(inside, by_obstacle, values)
        if event.exercised_at_zero:
            at_zero = by_obstacle[:, 0]
    for place, jump in jumps:
        values = values + jump * _projected_step(nodes, place)
    return Tangents(values, at_zero)


def event_changes(directions: tuple[Direction, ...], number: int) -> Matrix:
    """Return the derivatives of amount and escrow at the end of segment `number`, in strikes, shape (P, 2)."""
    return np.array(
        [
            [direction.change(number, of) / direction.up.strike for of in (_amount, _escrow)]
            for direction in directions
        ]
    )


def kernel_arguments(
    form: SegmentForm, tangents: Tangents, directions: tuple[Direction, ...], number: int
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return the derivatives that the march over segment `number` takes: values, operators, changes and lines."""
    escrow = event_changes(directions, number)[:, 1]
    rates = [[direction.change(number, of) for of in (_rate, _dividend_yield)] for direction in directions]
    changes = np.column_stack([rates, escrow])
    operators = _operators(form.grid, directions, number, changes)
    lines = np.array([end_lines(form.grid.nodes, row) for row in tangents.values])
    return tangents.values, operators, changes, lines


def _operators(grid: Grid, directions: tuple[Direction, ...], number: int, changes: Matrix) -> Matrix:
    """Return the derivatives of L by the parameters, shape (P, 3, N)."""
    first, second, _ = difference_operators(grid)
    s = grid.interior
    found = np.zeros((len(directions), 3, s.size))
    for rows, direction, change in zip(found, directions, changes, strict=True):
        up, down = direction.up.segments[number], direction.down.segments[number]
        if up.volatility == down.volatility and not change[:2].any():
            continue
        diffusion = (raised_diffusion(grid, up) - raised_diffusion(grid, down)) / (2.0 * direction.step)
        drift = (change[0] - change[1]) * s
        for k, name in enumerate(("lower", "diagonal", "upper")):
            rows[k] = diffusion * getattr(second, name) + drift * getattr(first, name)
        rows[1] -= change[0]
    return found


def _projected_step(nodes: Vector, place: float) -> Vector:
    """Return what projecting a step from 0 to 1 on hat functions adds to its values at the nodes."""
    added = np.zeros(nodes.size)
    if nodes[1] < place < nodes[-2]:
        i = int(np.searchsorted(nodes, place, side="right")) - 1
        h = nodes[i + 1] - nodes[i]
        below = (place - nodes[i]) / h
        added[i] = h * (1.0 - below) ** 2 / (nodes[i + 1] - nodes[i - 1])
        added[i + 1] = -h * below**2 / (nodes[i + 2] - nodes[i])
    return added


def _rate(segment: Segment) -> float:
    return segment.rate


def _dividend_yield(segment: Segment) -> float:
    return segment.dividend_yield


def _amount(segment: Segment) -> float:
    return segment.amount


def _escrow(segment: Segment) -> float:
    return segment.escrow
