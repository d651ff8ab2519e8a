"""Simulate a linear complementarity system by time stepping with error control."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_vector
from pricing_core.errors import InvalidInputError, RelativeDegreeError
from pricing_core.lcp import Method
from pricing_core.lcs.system import LCS
from pricing_core.lcs.time_stepping import LCSStage, LCSState, Scheme, SwitchControl, continue_from, jump
from pricing_core.lcs.trajectory import Event, Trajectory
from pricing_core.lcs.transfer import relative_degree
from pricing_core.stepping import FixedStep, ImplicitEuler, PIController, Sdirk2, StepDoubling, integrate
from pricing_core.stepping.controller import StepSizeController
from pricing_core.stepping.method import OneStepMethod

JUMP_STEP = 1e-10  # fraction of the interval that stands for an instant
SMALLEST_STEP = 1e-9  # fraction of the interval
LARGEST_RELATIVE_DEGREE = {"sdirk2": 1, "implicit-euler": 2}


@dataclass(frozen=True, slots=True)
class _Run:
    """The numerical choices of one simulation."""

    method: OneStepMethod[LCSState]
    controller: StepSizeController
    consistent_within: float
    interrupt: Callable[[], bool] | None


def simulate(
    system: LCS,
    x0: ArrayLike,
    t_span: tuple[float, float],
    *,
    method: Literal["time-stepping"] = "time-stepping",
    scheme: Scheme | Literal["auto"] = "auto",
    h: float | None = None,
    rtol: float = 1e-5,
    atol: ArrayLike = 1e-8,
    t_eval: ArrayLike | None = None,
    lcp_method: Method = "auto",
    interrupt: Callable[[], bool] | None = None,
) -> Trajectory:
    """Simulate from x0 over t_span, one LCP per implicit stage (11.65).

    Parameters
    ----------
    system : LCS
    x0 : array_like, shape (n,)
        Need not satisfy the constraints: a first jump carries it there.
    t_span : (float, float)
    method : {"time-stepping"}
    scheme : {"auto", "implicit-euler", "sdirk2"}
        "auto" takes the second-order "sdirk2" for relative degree 0 and 1, where the state is continuous after
        the start, and "implicit-euler" for relative degree 2, where it may jump at any time.
    h : float, optional
        Constant step; without it a PI controller keeps the local error, estimated by step doubling, below
        atol + rtol |x|. A switch of mode is located to that accuracy, or to 1e-9 of the interval.
    atol : float or array_like of shape (n,)
    t_eval : array_like, optional
        Times inside t_span to report, met exactly by steps; by default every step is reported.
    lcp_method : str
        See `pricing_core.lcp.solve`.
    interrupt : callable, optional
        Asked before every step; True ends the run with status "interrupted".

    Raises
    ------
    RelativeDegreeError
        The scheme cannot converge: relative degree 3 or more, or 2 with "sdirk2".
    InfeasibleError, RayTerminationError
        A step has no solution, or none was found.
    StepSizeError
        The tolerance could not be met.

    Examples
    --------
    A particle on the half line, x' = -1 + u, 0 <= x _|_ u >= 0, comes to rest at 0:

    >>> system = LCS([[0.0]], [[1.0]], [[1.0]], f=[-1.0])
    >>> trajectory = simulate(system, [0.5], (0.0, 1.0), t_eval=[0.25, 1.0])
    >>> bool(np.allclose(trajectory.x.ravel(), [0.25, 0.0], atol=1e-6)), trajectory.u[-1]
    (True, array([1.]))
    """
    start = as_vector("x0", x0, system.shape[0])
    if method != "time-stepping":
        raise InvalidInputError("method", method, '"time-stepping"')
    t0, t1 = _checked_span(t_span)
    chosen = _choose_scheme(system, scheme)
    stage = LCSStage(system, lcp_method)
    one_step = Sdirk2(stage) if chosen == "sdirk2" else ImplicitEuler(stage)
    size = float(np.max(np.abs(start), initial=0.0))
    run = _Run(
        method=one_step
        if h is not None
        else SwitchControl(StepDoubling(one_step), system, SMALLEST_STEP * (t1 - t0)),
        controller=FixedStep(h) if h is not None else PIController(rtol, atol, start=1e-3),
        consistent_within=1e-12 * max(1.0, size) * max(1.0, float(np.max(np.abs(system.C), initial=0.0))),
        interrupt=interrupt,
    )
    reported = None if t_eval is None else as_vector("t_eval", t_eval)
    if reported is not None and not np.all(
        (reported >= t0) & (reported <= t1) & (np.diff(reported, prepend=t0) >= 0)
    ):
        raise InvalidInputError("t_eval", t_eval, f"increasing and inside [{t0:g}, {t1:g}]")
    return _assemble(system, start, (t0, t1), run, reported, chosen)


def _assemble(
    system: LCS, x: Vector, span: tuple[float, float], run: _Run, reported: Vector | None, scheme: str
) -> Trajectory:
    """Integrate between the times at which an input changes, with a jump wherever the state must."""
    t0, t1 = span
    knots = sorted({float(k) for k in (*system.f.jumps, *system.g.jumps) if t0 < k < t1})
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
    table = np.array(times)
    if reported is None:
        keep = np.arange(table.size)
    else:  # the last of equal times: after the jump
        keep = np.searchsorted(table, reported[reported <= table[-1]], side="right") - 1
    return Trajectory(
        t=table[keep],
        x=np.array([states[i].value for i in keep]).reshape(keep.size, system.shape[0]),
        u=np.array([states[i].multiplier for i in keep]).reshape(keep.size, system.shape[1]),
        y=np.array([states[i].slack for i in keep]).reshape(keep.size, system.shape[1]),
        events=tuple(events),
        status=status,
        scheme=scheme,
        accepted=int(counts[0]),
        rejected=int(counts[1]),
        forced=int(counts[2]),
    )


def _enter(
    system: LCS, x: Vector, t: float, input_changes: bool, h: float, consistent_within: float
) -> tuple[LCSState, Event | None]:
    """Return the state just after t, and the jump or change of input if there is one."""
    state = continue_from(system, x, t, consistent_within)
    if state is not None:
        return state, Event(t, "input", x, x, np.zeros(system.shape[1])) if input_changes else None
    landed = jump(system, x, t, h)
    event = Event(t, "jump", x, landed.value, h * landed.multiplier)
    # The multiplier of the jump is impulse / h; what holds after it is the ordinary one.
    return continue_from(system, landed.value, t, consistent_within) or landed, event


def _choose_scheme(system: LCS, scheme: Scheme | Literal["auto"]) -> Scheme:
    if scheme not in ("auto", *LARGEST_RELATIVE_DEGREE):
        raise InvalidInputError("scheme", scheme, '"auto", "implicit-euler" or "sdirk2"')
    degree = relative_degree(system)
    chosen: Scheme = ("sdirk2" if degree <= 1 else "implicit-euler") if scheme == "auto" else scheme
    if degree > LARGEST_RELATIVE_DEGREE[chosen]:
        remedy = (
            "use implicit-euler" if degree == 2 else "no time-stepping scheme of this kind converges for it"
        )
        raise RelativeDegreeError(
            f"the system has relative degree {degree}; {chosen} converges up to "
            f"{LARGEST_RELATIVE_DEGREE[chosen]}: {remedy}"
        )
    return chosen


def _checked_span(t_span: tuple[float, float]) -> tuple[float, float]:
    t0, t1 = (float(t) for t in t_span)
    if not (math.isfinite(t0) and math.isfinite(t1) and t1 > t0):
        raise InvalidInputError("t_span", t_span, "two finite numbers with t_span[0] < t_span[1]")
    return t0, t1
