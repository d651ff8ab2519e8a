"""The time loop: attempt a step, accept or reject it, choose the next, stop exactly at the stop times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, Literal

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, StepSizeError
from pricing_core.stepping.controller import StepSizeController
from pricing_core.stepping.method import OneStepMethod, State

STRETCH_TO_STOP = 1.01  # a step that leaves less than 1 % of itself before a stop time is stretched to it


@dataclass(frozen=True, slots=True)
class Integration(Generic[State]):
    """The accepted states of one run.

    Parameters
    ----------
    t : Vector, shape (m + 1,)
        The start and the end of every accepted step.
    states : tuple of State, length m + 1
    accepted, rejected, forced : int
        Steps kept, steps repeated with a smaller h, and steps kept at the smallest h in spite of their error.
    status : {"finished", "interrupted"}
    """

    t: Vector
    states: tuple[State, ...]
    accepted: int
    rejected: int
    forced: int
    status: Literal["finished", "interrupted"]


def integrate(
    method: OneStepMethod[State],
    state: State,
    t_span: tuple[float, float],
    *,
    controller: StepSizeController,
    stop_times: Iterable[float] = (),
    smallest_h: float | None = None,
    force_smallest: bool = False,
    max_steps: int = 100_000,
    interrupt: Callable[[], bool] | None = None,
) -> Integration[State]:
    """Integrate from t_span[0] to t_span[1] >= t_span[0].

    Parameters
    ----------
    state : object
        The state at t_span[0], of the kind that the method takes.
    t_span : tuple of float
        Beginning and end.
    method : OneStepMethod
        Adaptive controllers need its error estimate: see `StepDoubling`.
    controller : StepSizeController
    stop_times : iterable of float
        Times inside the interval at which a step must end.
    smallest_h : float, optional
        Default: 1e-12 of the interval.
    force_smallest : bool
        Keep a step of the smallest size whatever its error (a jump inside it has no small step).
    interrupt : callable, optional
        Asked before every step; True ends the run with status "interrupted".

    Raises
    ------
    StepSizeError
        h would fall below `smallest_h`, or `max_steps` attempts were not enough.
    """
    start, end = t_span
    if not (math.isfinite(start) and math.isfinite(end) and end >= start):
        raise InvalidInputError("t_span", t_span, "finite with t_span[1] >= t_span[0]")
    smallest = 1e-12 * (end - start) if smallest_h is None else smallest_h
    stops = [s for s in sorted({*stop_times, end}) if start < s <= end]
    times, states = [start], [state]
    proposed, previous = controller.first_h(end - start), 0.0
    rejected = forced = 0
    t, next_stop = start, 0
    while next_stop < len(stops):
        if interrupt is not None and interrupt():
            return Integration(
                np.array(times), tuple(states), len(times) - 1, rejected, forced, "interrupted"
            )
        if len(times) - 1 + rejected >= max_steps:
            raise StepSizeError(f"{max_steps} steps reached only t = {t:g} of {end:g}: loosen the tolerance")
        stop = stops[next_stop]
        cut = t + STRETCH_TO_STOP * proposed >= stop
        h = stop - t if cut else proposed
        step = method.step(t, state, h)
        decision = controller.decide(step.value, step.error, h, method.order, previous)
        if not decision.accept and h <= smallest:
            if not force_smallest:
                raise StepSizeError(
                    f"the step at t = {t:g} misses its tolerance {decision.scaled_error:.1e} times even at the "
                    f"smallest step {smallest:.1e}: the solution jumps there, or the tolerance is too tight"
                )
            forced += 1
        elif not decision.accept:
            rejected += 1
            proposed = max(decision.next_h, smallest)
            continue
        # A step cut short by a stop time says little about the size to go on with.
        proposed = max(decision.next_h, proposed if cut and decision.accept else 0.0, smallest)
        previous = decision.scaled_error
        t, state = (stop, step.state) if cut else (t + h, step.state)
        next_stop += cut
        times.append(t)
        states.append(state)
    return Integration(np.array(times), tuple(states), len(times) - 1, rejected, forced, "finished")
