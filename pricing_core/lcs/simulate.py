"""Simulate a linear complementarity system: the front door to event-driven simulation and to time stepping."""

from collections.abc import Callable
from typing import Literal

from numpy.typing import ArrayLike

from pricing_core.arrays import as_vector, as_whole_number, check_callable
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcp import Method
from pricing_core.lcs.event_driven import Rebound, drive_by_events
from pricing_core.lcs.mode_selection import OnNonUnique
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.lcs.stepped_simulation import StepChoices, simulate_by_steps
from pricing_core.lcs.system import LCS
from pricing_core.lcs.time_stepping import Multipliers, Scheme
from pricing_core.lcs.trajectory import Trajectory

MAX_EVENTS = 100_000


def simulate(
    system: LCS,
    x0: ArrayLike,
    t_span: tuple[float, float],
    *,
    method: Literal["event-driven", "time-stepping"] = "event-driven",
    t_eval: ArrayLike | None = None,
    on_nonunique: OnNonUnique = "raise",
    max_events: int = MAX_EVENTS,
    rebound: Rebound | None = None,
    scheme: Scheme | Literal["auto"] = "auto",
    theta: float | None = None,
    h: float | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    lcp_method: Method = "auto",
    multipliers: Multipliers = "any",
    interrupt: Callable[[], bool] | None = None,
) -> Trajectory:
    """Simulate x' = Ax + Bu + f, y = Cx + Du + g, 0 <= y _|_ u >= 0 from x0 over t_span.

    "event-driven" follows (11.78): the flow in a mode is exact, its events are located to rounding, and modes are
    selected, and jumps made, by the rational complementarity problem. No excursion of an output below -1e-11 of its
    size is missed; transversal events are located to 1e-12, a contact of multiplicity m to the m-th root of that.
    Where events accumulate, their limit is extrapolated and the run goes on from there. What has died out is no longer
    followed, so that a long interval costs little once the state has settled.

    "time-stepping" solves one LCP per implicit stage (11.65), with error control: the robust second way, of order 1
    or 2, for systems with hundreds of pairs.

    Parameters
    ----------
    system : LCS
    x0 : array_like, shape (n,)
        Need not satisfy the constraints: a first jump carries it there.
    t_span : (float, float)
    t_eval : array_like, optional
        Times inside t_span to report, increasing. By default the ends of steps, events twice: before and after.
    on_nonunique : {"raise", "first"} or callable
        What happens where a state has several continuations: an error, the one nearest the present mode, or that
        which the callable chooses, given t, x and the modes. Inputs that no output sees are an error too, unless a
        choice is made: they are then zero. Event-driven only, and for k <= 10: with more pairs the first continuation
        that is found is taken.
    max_events : int
        Of an event-driven run.
    rebound : callable, optional
        Another law for the jumps of an event-driven run than the projection of (11.78), for systems with D = 0: given
        the states before and after that and the pairs with y_i = 0, it returns the state to go on from and the
        impulse of u.
    scheme : {"auto", "implicit-euler", "sdirk2", "theta"}
        Of time stepping. "auto" takes the second-order "sdirk2" for relative degree 0 and 1, where the state is
        continuous after the start, and "implicit-euler" for relative degree 2, where it may jump at any time.
    theta : float, optional
        Implicit weight of "theta", at least 1/2 and at most 1; 1/2 if missing.
    h : float, optional
        Constant step of time stepping; without it a PI controller keeps the local error, estimated by step doubling,
        below atol + rtol |x|. A switch of mode is located to that accuracy, or to 1e-9 of the interval.
    rtol, atol : float, and float or array_like of shape (n,), optional
        Of time stepping; 1e-5 and 1e-8 if missing.
    lcp_method : str
        Of time stepping; see `pricing_core.lcp.solve`.
    multipliers : {"any", "least-norm"}
        Of time stepping: where the step's multipliers are not unique, those of least norm (for positive semidefinite
        problems; Han, Tiwari, Camlibel, Pang 2009). Event-driven runs always report these.
    interrupt : callable, optional
        Asked before every step; True ends the run with status "interrupted".

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed, or belongs to the other method.
    InfeasibleError
        No mode goes on from a state, or a step has no solution.
    NonUniqueError
        A state has several continuations, and none was chosen.
    ZenoError
        Events accumulate at an instant from which nothing goes on.
    IterationLimitError
        More than max_events events, more than 100 000 Taylor polynomials, or endless reinitialisations at one instant.
    NumericalError
        The state or an input overflows.
    RelativeDegreeError
        The stepping scheme cannot converge: relative degree 3 or more, or 2 with "sdirk2" or "theta".
    RayTerminationError, StepSizeError
        A step's solution was not found; the tolerance could not be met.

    Notes
    -----
    Cost of an event: some tenths of a millisecond, and once for every mode that is met about 2 ms (n + k <= 24).

    Examples
    --------
    A particle on the half line, x' = -1 + u, 0 <= x _|_ u >= 0, comes to rest at 0:

    >>> system = LCS([[0.0]], [[1.0]], [[1.0]], f=[-1.0])
    >>> trajectory = simulate(system, [0.5], (0.0, 1.0))
    >>> [(event.kind, event.time, event.mode_after) for event in trajectory.events]
    [('switch', 0.5, (0,))]
    >>> trajectory(0.25), trajectory.u[-1]
    (array([0.25]), array([1.]))
    """
    start = as_vector("x0", x0, system.shape[0])
    span = checked_span(t_span)
    reported = None if t_eval is None else checked_times(t_eval, span)
    if interrupt is not None:
        check_callable("interrupt", interrupt, "nothing")
    if method == "time-stepping":
        if rebound is not None:
            raise InvalidInputError("rebound", Told("a law"), 'left out with method="time-stepping"')
        choices = StepChoices(scheme, theta, h, rtol, atol, lcp_method, multipliers)
        return simulate_by_steps(system, start, span, reported, choices, interrupt)
    if method != "event-driven":
        raise InvalidInputError("method", method, '"event-driven" or "time-stepping"')
    foreign = {"theta": theta, "h": h, "rtol": rtol, "atol": atol}
    for name, value in foreign.items():
        if value is not None:
            raise InvalidInputError(name, value, 'left out with method="event-driven", which is exact')
    if not (on_nonunique in ("raise", "first") or callable(on_nonunique)):
        raise InvalidInputError(
            "on_nonunique", on_nonunique, '"raise", "first" or a function of (t, x, modes)'
        )
    if rebound is not None:
        check_callable("rebound", rebound, "the states before and after, and the contacts")
    return drive_by_events(
        system,
        start,
        span,
        reported,
        on_nonunique=on_nonunique,
        max_events=as_whole_number("max_events", max_events, 0),
        rebound=rebound,
        interrupt=interrupt,
    )
