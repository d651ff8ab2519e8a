"""Work on many contracts that asks for sweeps now and then: the sweeps of all of them are done together.

What is done contract by contract, as to refine until the error is small enough, is written as a generator: it yields
the sweeps that it needs next and is sent what they found. So one contract is treated as many are, and many fill the
lanes of the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

from pricing_core.american.engines.method_of_lines.spot_values import at_spots
from pricing_core.american.engines.method_of_lines.sweep import sweep_together
from pricing_core.american.engines.method_of_lines.sweep_problem import Sweep, SweepRequest
from pricing_core.arrays import Matrix


class Answer(NamedTuple):
    """A sweep, and what it says at the schedule's spot, see `at_spot`."""

    sweep: Sweep
    at_spot: Matrix  # (1 + P, 4)


T = TypeVar("T")
# Yields requests, is sent the answers, None where interrupted, and returns T.
Work = Generator[list[SweepRequest], list[Answer | None], T]


def done(work: Work[T], interrupt: Callable[[], bool] | None = None) -> T:
    """Return what one piece of work returns."""
    return done_together([work], interrupt)[0]


def done_together(works: Sequence[Work[T]], interrupt: Callable[[], bool] | None = None) -> list[T]:
    """Return what each piece of work returns; what a sweep raises is raised in the work that asked for it."""
    results: dict[int, T] = {}
    waiting: list[tuple[int, list[SweepRequest]]] = []

    def proceed(place: int, go: Callable[[], list[SweepRequest]]) -> None:
        try:
            waiting.append((place, go()))
        except StopIteration as stop:
            results[place] = stop.value

    for place, work in enumerate(works):
        proceed(place, partial(next, work))
    while waiting:
        asked = waiting.copy()
        waiting.clear()
        found = iter(_answers([request for _, requests in asked for request in requests], interrupt))
        for place, requests in asked:
            answers: list[Answer | None] = []
            failure: Exception | None = None
            for _ in requests:
                answer = next(found)
                if isinstance(answer, Exception):
                    failure = answer
                else:
                    answers.append(answer)
            work = works[place]
            proceed(place, partial(work.send, answers) if failure is None else partial(work.throw, failure))
    return [results[place] for place in range(len(works))]


def _answers(
    requests: Sequence[SweepRequest], interrupt: Callable[[], bool] | None
) -> list[Answer | Exception | None]:
    swept = _swept(requests, interrupt)
    sweeps = [sweep for sweep in swept if isinstance(sweep, Sweep)]
    spots = [
        request.schedule.spot / request.schedule.strike
        for request, sweep in zip(requests, swept, strict=True)
        if isinstance(sweep, Sweep)
    ]
    local = iter(at_spots(sweeps, spots))
    answers: list[Answer | Exception | None] = []
    for sweep in swept:
        if not isinstance(sweep, Sweep):
            answers.append(sweep)
            continue
        at_spot = next(local)
        answers.append(at_spot if isinstance(at_spot, Exception) else Answer(sweep, at_spot))
    return answers


def _swept(
    requests: Sequence[SweepRequest], interrupt: Callable[[], bool] | None
) -> list[Sweep | Exception | None]:
    """Return what `sweep_together` does, with equal sweeps of contracts that share them done once."""
    found: dict[Hashable, Sweep | Exception | None] = {}
    keys: list[tuple[Hashable, ...]] = []
    wanted: list[int] = []
    for place, request in enumerate(requests):
        shared = request.shared
        keys.append((place,) if shared is None else (id(shared), request.key))
        if shared is not None and keys[-1][1] in shared.found:
            found[keys[-1]] = shared.found[keys[-1][1]]
        elif keys[-1] not in found:
            found[keys[-1]] = None
            wanted.append(place)
    swept = sweep_together([requests[place] for place in wanted], interrupt)
    for place, sweep in zip(wanted, swept, strict=True):
        found[keys[place]], shared = sweep, requests[place].shared
        if shared is not None and sweep is not None:
            shared.found[keys[place][1]] = sweep
    return [found[key] for key in keys]
