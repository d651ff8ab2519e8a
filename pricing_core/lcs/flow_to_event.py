"""The flow in one mode up to the first output that becomes negative, by Taylor steps, closed form, or its slow part."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.kernel import taylor_step
from pricing_core.lcs.closed_form import ClosedForm
from pricing_core.lcs.flow import Flow
from pricing_core.lcs.guards import Guards
from pricing_core.lcs.mode_dynamics import DEGREE, ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.run_record import RunRecord
from pricing_core.lcs.trajectory import Event

CROSSES = 1e-11  # of an output's size: how far below zero counts
AT_THE_END = 1e-13  # of the interval
FIRST_LOOK = 4  # steps of a flow after which it is asked whether anything can happen, and after twice as many
AHEAD = 4.0  # least length, in steps, of what is passed at once
AGREES = 1e-11  # of the size: how closely the closed form must meet a Taylor polynomial
FLAT = 1e3  # tolerances: an output that stays below is zero, and touches nothing


class FlowEnd(NamedTuple):
    """Where a flow ends, and the outputs that cross zero there: none at the end, or where what is fast has died."""

    time: float
    c: State
    crossed: list[int]
    is_low: bool  # whether what crosses had left zero by no more than rounding, or does so next to still


@dataclass(frozen=True, slots=True, eq=False)
class FlowToEvent:
    """Follows modes, and notes flows and outputs that touch zero.

    Parameters
    ----------
    record : RunRecord
    selector : ModeSelector
        Which knows the slow part and the closed form of a mode.
    span : (float, float)
        The interval of the run.
    interrupt : callable, optional
    guards : Guards, optional
        What else must not become negative.
    """

    record: RunRecord
    selector: ModeSelector
    span: tuple[float, float]
    interrupt: Callable[[], bool] | None
    guards: Guards | None = None
    _watched: dict[int, Matrix] = field(default_factory=dict, init=False, repr=False)

    def watched(self, dynamics: ModeDynamics) -> Matrix:
        """Return what must not become negative, as functions of the coordinates: the outputs, then the guards."""
        if self.guards is None:
            return dynamics.outputs
        key = id(dynamics)  # all dynamics are kept
        if key not in self._watched:
            self._watched[key] = np.vstack([dynamics.outputs, self.guards.rows(self.record.form, dynamics)])
        return self._watched[key]

    def follow(self, dynamics: ModeDynamics, c: State, t: float, end: float) -> FlowEnd | None:
        """Flow until an output crosses zero, the fast part has died out, or the interval ends; None if interrupted.

        Guards that cross are numbered after the outputs. What crosses zero at a knot of the input is left to the input
        after the knot.
        """
        form = self.record.form
        slow = self.selector.slow_part(dynamics)
        flow = Flow(form, dynamics, t, t, largest=float(c.sizes.max(initial=0.0)))
        self.record.flows.append(flow)
        length = dynamics.step / form.units.rate
        t0, t1 = self.span
        close = max(AT_THE_END * (t1 - t0), 4.0 * math.ulp(max(abs(t0), abs(t1))))
        values, sizes = c
        watched = self.watched(dynamics)
        while True:
            flow.times.append(t)
            flow.coordinates.append(values)
            if self.interrupt is not None and self.interrupt():
                flow.end = t
                return None
            if self._is_quiet(State(values, sizes), end, flow):
                return self._passed(State(values, sizes), end, flow)
            reach = min(1.0, (end - t) / length) if end > t else 0.0
            start, known = values, sizes
            place, crossed, values, sizes, flat, is_slow, may_touch = taylor_step(
                dynamics.scaled_rate, watched, start, sizes, reach, CROSSES
            )
            check_size(sizes, t)
            if may_touch:
                self._note_touching(flow, start, sizes, (t, length), place)
            is_low = (flat and len(flow.times) == 1) or is_slow
            t = end if not crossed and reach < 1.0 else t + (place * length if place > 0.0 else 0.0)
            if t >= end - close and (not crossed or end < t1):
                t = end
                # What is left of terms that cancel is rounding of what they were at the step's start.
                terms = np.maximum(np.maximum(sizes, known), np.abs(dynamics.scaled_rate) @ np.abs(start))
                crossed = _falling(dynamics, State(values, terms)) if end == t1 else []
            if crossed or t >= end or (slow is not None and slow.is_all_of(values)):
                flow.end, flow.final = t, values
                flow.falls = watched[crossed[0]] if crossed else None
                return FlowEnd(t, State(values, sizes), crossed, is_low)

    def _is_quiet(self, c: State, end: float, flow: Flow) -> bool:
        """Tell whether no output can reach zero up to `end`: the flow then knows its closed form."""
        count, rate, dynamics = len(flow.times), self.record.form.units.rate, flow.dynamics
        if count < FIRST_LOOK or count & (count - 1):
            return False
        length = (end - flow.times[-1]) * rate
        if length < AHEAD * dynamics.step:
            return False
        slow = self.selector.slow_part(dynamics)
        if slow is not None and slow.dynamics.rate.size:  # what is fast will have died out first
            return False
        closed = self.selector.closed_form(dynamics)
        if closed is None:
            return False
        if not (_stays_away(self.watched(dynamics), closed, c, length) and _agrees(dynamics, closed, c.z)):
            return False
        flow.closed = closed
        return True

    def _passed(self, c: State, end: float, flow: Flow) -> FlowEnd:
        """Pass the rest of the interval at once."""
        assert flow.closed is not None
        length = (end - flow.times[-1]) * self.record.form.units.rate
        values = flow.closed.states(c.z, np.array([length]))[0]
        check_size(values, end)
        flow.end, flow.final = end, values
        return FlowEnd(end, State(values, np.maximum(c.sizes, np.abs(values))), [], False)

    def _note_touching(
        self, flow: Flow, start: Vector, sizes: Vector, step: tuple[float, float], place: float
    ) -> None:
        """Note the outputs that touch zero on the way without crossing it."""
        dynamics, (t, length) = flow.dynamics, step
        terms = _expansion(dynamics, start)
        swept = np.maximum(sizes, (place ** np.arange(len(terms))) @ np.abs(terms))
        tolerances = CROSSES * np.maximum(dynamics.output_sizes @ swept, 1e-290)
        for touch in touching_places(terms @ dynamics.outputs.T, place, tolerances):
            x = self.record.state(dynamics.basis @ (touch ** np.arange(len(terms)) @ terms))
            event = Event(
                t + touch * length, "grazing", x, x, self.record.no_impulse(), dynamics.mode, dynamics.mode
            )
            self.record.note(event)


def touching_places(polynomials: Matrix, end: float, tolerances: Vector) -> list[float]:
    """Return where in (0, end) outputs touch zero, to within their tolerance, without crossing it.

    Parameters
    ----------
    polynomials : Matrix, shape (m, k)
        Coefficients, lowest power first.
    """
    found = []
    for polynomial, tolerance in zip(polynomials.T, tolerances, strict=True):
        slope = np.polynomial.polynomial.polyder(np.trim_zeros(polynomial, "b"))
        roots = np.polynomial.polynomial.polyroots(slope) if slope.size > 1 else np.zeros(0)
        real = roots[np.abs(roots.imag) < 1e-6].real
        for place in real[(real > 1e-6 * end) & (real < (1.0 - 1e-6) * end)]:
            around = [max(place - 0.05 * end, 0.0), place, min(place + 0.05 * end, end)]
            before, value, after = np.polynomial.polynomial.polyval(around, polynomial)
            if abs(value) <= tolerance and min(before, after) > FLAT * tolerance:
                found.append(float(place))
    return sorted(found)


def _expansion(dynamics: ModeDynamics, c: Vector) -> Matrix:
    """Return the Taylor coefficients of the coordinates in time/step, shape (DEGREE + 1, d)."""
    terms = [c]
    for j in range(1, DEGREE + 1):
        terms.append(dynamics.scaled_rate @ terms[-1] / j)
    return np.array(terms)


def _stays_away(watched: Matrix, closed: ClosedForm, c: State, length: float) -> bool:
    """Tell whether everything that is watched is positive, or zero, for so long."""
    low, high = closed.bounds(watched, c.z, length)
    levels = CROSSES * np.abs(watched) @ np.maximum(c.sizes, np.abs(c.z))
    return bool(((low > levels) | ((low >= -levels) & (high <= levels))).all())


def _agrees(dynamics: ModeDynamics, closed: ClosedForm, c: Vector) -> bool:
    """Tell whether the closed form meets a Taylor polynomial at its end."""
    terms = _expansion(dynamics, c)
    ahead = closed.states(c, np.array([dynamics.step]))[0]
    apart = float(np.abs(ahead - terms.sum(axis=0)).max(initial=0.0))
    return apart <= AGREES * float(np.abs(terms).sum(axis=0).max(initial=0.0))


def _falling(dynamics: ModeDynamics, c: State) -> list[int]:
    """Return the outputs that are about to become negative."""
    return np.flatnonzero(dynamics.initial_signs(c) < 0.0).tolist()
