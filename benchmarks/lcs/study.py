"""Error against time of event-driven simulation and of time stepping, and what large systems take."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from benchmarks.lcs.problems import KnownProblem, integer_system, passive_network
from benchmarks.measuring.timing import Task, least_seconds
from pricing_core.lcs import TimeStepping, Trajectory, simulate, well_posedness

EVENT_DRIVEN = "event-driven"
INTEGER_KINDS = ("any", "no feedthrough", "dominant")


class LcsRun(NamedTuple):
    """One simulation: its error as a fraction of the states' sizes, its time, steps (accepted) and events."""

    problem: str
    method: str
    tolerance: float | None
    seconds: float
    error: float
    steps: int
    events: int


class LargeRun(NamedTuple):
    """A system of n states and k pairs, the task, its time and its result."""

    question: str
    n: int
    k: int
    seconds: float
    answer: str


def study_problem(problem: KnownProblem, tolerances: Sequence[float]) -> tuple[LcsRun, ...]:
    """Simulate by both methods; time stepping at every tolerance, with error control."""
    span = (0.0, float(problem.times[-1]))
    start = partial(simulate, problem.system, problem.x0, span, t_eval=problem.times)
    runs: dict[tuple[str, float | None], Callable[[], Trajectory]] = {(EVENT_DRIVEN, None): start}
    runs |= {
        (scheme, tolerance): partial(
            start,
            method=TimeStepping(scheme, tolerance=0.0, absolute_tolerance=tolerance * problem.scale),
        )
        for scheme in problem.schemes
        for tolerance in tolerances
    }
    times = least_seconds([Task((run,)) for run in runs.values()], turns=1)
    return tuple(
        _run(problem, method, tolerance, seconds, run())
        for ((method, tolerance), run), seconds in zip(runs.items(), times, strict=True)
    )


def _run(
    problem: KnownProblem, method: str, tolerance: float | None, seconds: float, found: Trajectory
) -> LcsRun:
    error = problem.error(found.x)
    return LcsRun(problem.name, method, tolerance, seconds, error, found.accepted, len(found.events))


def study_large(n: int, k: int, steps: int, pairs: int) -> tuple[LargeRun, ...]:
    """Step a random passive system, and ask whether systems with `pairs` states and pairs are well-posed."""
    network = passive_network(n, k)
    step = partial(
        simulate,
        network,
        [0.0] * n,
        (0.0, steps / 100.0),
        method=TimeStepping("implicit-euler", step=0.01),
    )
    systems = {kind: integer_system(pairs, pairs, kind) for kind in INTEGER_KINDS}
    reports = [partial(well_posedness, system) for system in systems.values()]
    calls: list[Callable[[], object]] = [step, *reports]
    seconds = least_seconds([Task((call,)) for call in calls], turns=1)
    ends = (step().u[-1] > 0.0).sum()
    stepped = LargeRun(f"{steps:,} implicit Euler steps", n, k, seconds[0], f"{ends} multipliers at work")
    return (
        stepped,
        *(
            LargeRun(f"well-posed? integer data, {kind}", pairs, pairs, time, report().verdict)
            for kind, report, time in zip(INTEGER_KINDS, reports, seconds[1:], strict=True)
        ),
    )
