"""Simulate a linear complementarity system, from event to event or by time stepping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import as_vector, check_callable, check_type
from pricing_core.errors import InfeasibleError, InvalidInputError, NotFoundError, Told
from pricing_core.lcs.event_driven import drive_by_events
from pricing_core.lcs.infeasible_start import nothing_goes_on
from pricing_core.lcs.mode_selection import shown_state
from pricing_core.lcs.simulation_method import EventDriven, SimulationMethod, TimeStepping, as_method
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.lcs.stepped_simulation import simulate_by_steps
from pricing_core.lcs.stored_energy import with_energy_lost
from pricing_core.lcs.system import LCS
from pricing_core.lcs.trajectory import Trajectory


def simulate(
    system: LCS,
    x0: ArrayLike,
    t_span: tuple[float, float],
    *,
    method: SimulationMethod = "event-driven",
    t_eval: ArrayLike | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Trajectory:
    """Simulate x' = Ax + Bu + f, y = Cx + Du + g, 0 <= y _|_ u >= 0 from x0 over t_span.

    Parameters
    ----------
    system : LCS
    x0 : array_like, shape (n,)
        Need not satisfy the constraints: a first jump carries it there.
    t_span : (float, float)
    method : {"event-driven", "time-stepping"}, EventDriven or TimeStepping
        A name stands for the method with its defaults.
    t_eval : array_like, optional
        Times inside t_span to report, increasing. By default the ends of steps, events twice: before and after.
    interrupt : callable, optional
        Asked before every step; True ends the run with status "interrupted".

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed; a law of rebound for a system with D other than zero.
    InfeasibleError
        Proved: no mode goes on from x0.
    NotFoundError
        No mode that goes on from a state, or no solution of a step, was found: nothing is proved.
    NonUniqueError
        A state has several continuations, and none was chosen.
    ZenoError
        Events accumulate at an instant from which nothing goes on.
    IterationLimitError
        More than max_events events, or endless reinitialisations at one instant.
    NumericalError
        The state or an input overflows.
    RelativeDegreeError
        The stepping scheme cannot converge: relative degree 3 or more, or 2 with "sdirk2" or "theta".
    RayTerminationError, StepSizeError
        A step's solution was not found; the tolerance could not be met.

    Examples
    --------
    A particle on the half line, x' = -1 + u, 0 <= x _|_ u >= 0, comes to rest at 0:

    >>> system = LCS([[0.0]], [[1.0]], [[1.0]], f=[-1.0])
    >>> trajectory = simulate(system, [0.5], (0.0, 1.0))
    >>> [(event.kind, event.time, event.mode_after) for event in trajectory.events]
    [('switch', 0.5, (0,))]
    >>> trajectory(0.25), trajectory.u[-1]
    (array([0.25]), array([1.]))
    >>> simulate(system, [0.5], (0.0, 1.0), method=TimeStepping("implicit-euler", step=0.25)).x.ravel()
    array([0.5 , 0.25, 0.  , 0.  , 0.  ])
    """
    check_type("system", system, LCS)
    run = simulate_without_energy(system, x0, t_span, method=method, t_eval=t_eval, interrupt=interrupt)
    return replace(run, events=with_energy_lost(system, run.events)) if run.flows else run


def simulate_without_energy(
    system: LCS,
    x0: ArrayLike,
    t_span: tuple[float, float],
    *,
    method: SimulationMethod = "event-driven",
    t_eval: ArrayLike | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Trajectory:
    """Simulate as `simulate` does, and leave the energy that jumps lose to models that know it.

    A storage function of an unknown system costs as much as some hundred events.
    """
    start = as_vector("x0", x0, system.shape[0])
    span = checked_span(t_span)
    reported = None if t_eval is None else checked_times(t_eval, span)
    chosen = as_method(method)
    if interrupt is not None:
        check_callable("interrupt", interrupt, "nothing")
    if isinstance(chosen, EventDriven) and chosen.rebound is not None and np.any(system.D):
        raise InvalidInputError("rebound", Told("a law"), "left out for a system with D other than zero")
    try:
        if isinstance(chosen, TimeStepping):
            return simulate_by_steps(system, start, span, reported, chosen, interrupt)
        return drive_by_events(system, start, span, reported, chosen, interrupt)
    except NotFoundError as error:
        if nothing_goes_on(system, start, span[0]):
            text = f"no mode goes on from x = {shown_state(start)} at t = {span[0]:.12g}: proved"
            raise InfeasibleError(text) from error
        raise
