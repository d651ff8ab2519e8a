"""Simulate a nonlinear complementarity system in semi-explicit form (11.3) by implicit steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_vector, check_callable, check_type
from pricing_core.errors import InvalidInputError, IterationLimitError
from pricing_core.lcs.nonlinear_stage import NonlinearStage, RetriedSmaller
from pricing_core.lcs.semi_explicit import SemiExplicitSystem
from pricing_core.lcs.simulation_method import TimeStepping, check_unused
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.lcs.stepping_scheme import SMALLEST_STEP, choose_scheme, one_step_method, stepped_trajectory
from pricing_core.lcs.system import LCS
from pricing_core.lcs.time_stepping import LCSState, SwitchControl
from pricing_core.lcs.trajectory import Trajectory
from pricing_core.stepping import StepDoubling, integrate

CONSISTENT = 1e-12  # of the state: slacks at the start down to minus this count as zero


def simulate_nonlinear(
    system: SemiExplicitSystem,
    x0: ArrayLike,
    t_span: tuple[float, float],
    *,
    method: TimeStepping | Literal["time-stepping"] = "time-stepping",
    t_eval: ArrayLike | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Trajectory:
    """Simulate x' = f(x, u), y = h(x, u), 0 <= y _|_ u >= 0 from x0 over t_span.

    Every implicit stage is solved by Newton's method with an LCP in each iteration. The relative degree that the scheme
    "auto" goes by is that of the system linearised at x0.

    Parameters
    ----------
    system : SemiExplicitSystem
    x0 : array_like, shape (n,)
        On the constraints: h(x0, u) >= 0 for some u >= 0 with u _|_ y. Where f or h is nonlinear there is no accepted
        rule for a jump of the state (section 11.9).
    method : "time-stepping" or TimeStepping
        The name stands for the method with its defaults. The field `multipliers` has no effect here and is left out.
    t_span, t_eval, interrupt
        See `simulate`.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed; x0 violates the constraints.
    RelativeDegreeError
        The scheme cannot converge.
    IterationLimitError, StepSizeError
        Newton's method failed at a constant step, or at the smallest one; the tolerance could not be met.

    Examples
    --------
    x' = -1 - x**2 + u, 0 <= x _|_ u >= 0 from 1: x = tan(pi/4 - t), which is 0 at pi/4, and rests there with u = 1:

    >>> falling = SemiExplicitSystem(lambda x, u: u - 1.0 - x**2, lambda x, u: x, pairs=1)
    >>> fine = TimeStepping(tolerance=1e-7)
    >>> trajectory = simulate_nonlinear(falling, [1.0], (0.0, 2.0), method=fine, t_eval=[0.5, 2.0])
    >>> trajectory.x.ravel().round(5), trajectory.u.ravel().round(5)
    (array([0.29341, 0.     ]), array([0., 1.]))
    """
    check_type("system", system, SemiExplicitSystem)
    start = as_vector("x0", x0)
    t0, t1 = span = checked_span(t_span)
    reported = None if t_eval is None else checked_times(t_eval, span)
    if interrupt is not None:
        check_callable("interrupt", interrupt, "nothing")
    if isinstance(method, str) and method == "time-stepping":
        method = TimeStepping()
    if not isinstance(method, TimeStepping):
        raise InvalidInputError("method", method, '"time-stepping" or a TimeStepping(...)')
    check_unused(method, ("multipliers",), "a nonlinear system")
    stage = NonlinearStage(system, method.lcp_method)
    state = _consistent(stage, start, t0)
    local = system.linearised(state.value, state.multiplier)
    chosen = choose_scheme(LCS(local.f_x, local.f_u, local.h_x, local.h_u), method.scheme)
    one_step = one_step_method(stage, chosen, method.theta)
    smallest = SMALLEST_STEP * (t1 - t0)
    integration = integrate(
        one_step
        if method.step is not None
        else RetriedSmaller(SwitchControl(StepDoubling(one_step), _rates(system), smallest), smallest),
        state,
        span,
        controller=method.controller(start.size),
        stop_times=() if reported is None else reported,
        smallest_h=smallest,
        force_smallest=chosen == "implicit-euler",
        interrupt=interrupt,
    )
    return stepped_trajectory(
        integration.t.tolist(),
        integration.states,
        reported,
        events=(),
        status=integration.status,
        scheme=chosen,
        counts=(integration.accepted, integration.rejected, integration.forced),
    )


def _consistent(stage: NonlinearStage, x0: Vector, t0: float) -> LCSState:
    """Return the state at t0+, with u such that 0 <= y _|_ u >= 0 at x0."""
    idle = np.zeros(stage.system.pairs)
    slack = stage.system.slack(x0, idle)
    if np.all(slack >= -CONSISTENT * max(1.0, float(np.max(np.abs(x0), initial=0.0)))):
        return LCSState(x0, idle, np.maximum(slack, 0.0))
    try:
        return stage.solve(t0, x0, 0.0, LCSState(x0, idle, slack))
    except IterationLimitError as error:
        allowed = (
            f"on the constraints, as jumps of nonlinear systems are not defined; h(x0, 0) = {slack.tolist()}"
        )
        raise InvalidInputError("x0", x0.tolist(), allowed) from error


def _rates(system: SemiExplicitSystem) -> Callable[[LCSState, LCSState], Vector]:
    def change(before: LCSState, after: LCSState) -> Vector:
        return system.rate(after.value, after.multiplier) - system.rate(after.value, before.multiplier)

    return change
