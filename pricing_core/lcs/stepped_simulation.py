"""Time stepping of a linear complementarity system with error control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.simulation_method import TimeStepping
from pricing_core.lcs.stepping_scheme import SMALLEST_STEP, choose_scheme, one_step_method, stepped_trajectory
from pricing_core.lcs.system import LCS
from pricing_core.lcs.time_stepping import LCSStage, LCSState, SwitchControl, continue_from, jump
from pricing_core.lcs.trajectory import Event, Trajectory
from pricing_core.stepping import StepDoubling, integrate
from pricing_core.stepping.controller import StepSizeController
from pricing_core.stepping.method import OneStepMethod

JUMP_STEP = 1e-10  # fraction of the interval that stands for an instant


@dataclass(frozen=True, slots=True)
class _Run:
    """What the choices of a method come to for one system."""

    method: OneStepMethod[LCSState]
    controller: StepSizeController
    consistent_within: float
    interrupt: Callable[[], bool] | None


def simulate_by_steps(
    system: LCS,
    x0: Vector,
    t_span: tuple[float, float],
    t_eval: Vector | None,
    method: TimeStepping,
    interrupt: Callable[[], bool] | None,
) -> Trajectory:
    """Simulate from x0 over t_span, one LCP per implicit stage (11.65); see `simulate`."""
    t0, t1 = t_span
    chosen = choose_scheme(system, method.scheme)
    size = float(np.max(np.abs(x0), initial=0.0))
    stage = LCSStage(system, method.lcp_method, method.multipliers)
    one_step = one_step_method(stage, chosen, method.theta)
    run = _Run(
        method=one_step
        if method.step is not None
        else SwitchControl(
            StepDoubling(one_step), partial(_change_of_rate, system), SMALLEST_STEP * (t1 - t0)
        ),
        controller=method.controller(x0.size),
        consistent_within=1e-12 * max(1.0, size) * max(1.0, float(np.max(np.abs(system.C), initial=0.0))),
        interrupt=interrupt,
    )
    return _assemble(system, x0, t_span, run, t_eval, chosen)


def _assemble(
    system: LCS, x: Vector, span: tuple[float, float], run: _Run, reported: Vector | None, scheme: str
) -> Trajectory:
    """Integrate between the times at which an input changes, with a jump wherever the state must."""
    t0, t1 = span
    knots = sorted({*system.f.knots(t0, t1).tolist(), *system.g.knots(t0, t1).tolist()})
    times: list[float] = []
    states: list[LCSState] = []
    events: list[Event] = []
    counts = np.zeros(3, dtype=int)
    status: Literal["finished", "interrupted"] = "finished"
    for begin, end in zip([t0, *knots], [*knots, t1], strict=True):
        state, event = _enter(system, x, begin, begin > t0, (t1 - t0) * JUMP_STEP, run.consistent_within)
        events += [] if event is None else [event]
        integration = integrate(
            run.method,
            state,
            (begin, end),
            controller=run.controller,
            stop_times=() if reported is None else reported,
            smallest_h=SMALLEST_STEP * (end - begin),
            force_smallest=scheme == "implicit-euler",
            interrupt=run.interrupt,
        )
        times += integration.t.tolist()
        states += integration.states
        counts += integration.accepted, integration.rejected, integration.forced
        x = integration.states[-1].value
        status = integration.status
        if status == "interrupted":
            break
    accepted, rejected, forced = counts.tolist()
    return stepped_trajectory(
        times,
        states,
        reported,
        events=events,
        status=status,
        scheme=scheme,
        counts=(accepted, rejected, forced),
    )


def _change_of_rate(system: LCS, before: LCSState, after: LCSState) -> Vector:
    return np.asarray(system.B @ (after.multiplier - before.multiplier))


def _enter(
    system: LCS, x: Vector, t: float, input_changes: bool, h: float, consistent_within: float
) -> tuple[LCSState, Event | None]:
    """Return the state just after t, and the jump or change of input if there is one."""
    check_size(x, t)
    state = continue_from(system, x, t, consistent_within)
    if state is not None:
        return state, Event(t, "input", x, x, np.zeros(system.shape[1])) if input_changes else None
    landed = jump(system, x, t, h)
    event = Event(t, "jump", x, landed.value, h * landed.multiplier)
    # The multiplier of the jump is impulse / h; what holds after it is the ordinary one.
    return continue_from(system, landed.value, t, consistent_within) or landed, event
