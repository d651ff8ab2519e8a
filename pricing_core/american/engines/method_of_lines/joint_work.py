"""Work on many contracts that asks for sweeps now and then: the sweeps of all of them are done together.

What is done contract by contract, as to refine until the error is small enough, is written as a generator: it yields
the sweeps that it needs next and is sent what they found. So one contract is treated as many are, and many fill the
lanes of the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from functools import partial
from typing import TypeVar

from pricing_core.american.engines.method_of_lines.sweep import sweep_together
from pricing_core.american.engines.method_of_lines.sweep_problem import Sweep, SweepRequest

T = TypeVar("T")
# Yields requests, is sent their sweeps, None where interrupted, and returns T.
Work = Generator[list[SweepRequest], list[Sweep | None], T]


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
        found = iter(sweep_together([request for _, requests in asked for request in requests], interrupt))
        for place, requests in asked:
            sweeps: list[Sweep | None] = []
            failure: Exception | None = None
            for _ in requests:
                sweep = next(found)
                if isinstance(sweep, Exception):
                    failure = sweep
                else:
                    sweeps.append(sweep)
            work = works[place]
            proceed(place, partial(work.send, sweeps) if failure is None else partial(work.throw, failure))
    return [results[place] for place in range(len(works))]
