"""Times of calls that are repeated in turn, so that noise on the machine meets them all."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

TURNS, IN_A_ROW = 3, 2  # each call is timed six times


def _nothing() -> None:
    pass


@dataclass(frozen=True, slots=True)
class Task:
    """Work to be timed, cut into calls; `prepare` runs before them and is not timed."""

    calls: tuple[Callable[[], object], ...]
    prepare: Callable[[], object] = _nothing


def least_seconds(tasks: Sequence[Task], turns: int = TURNS) -> tuple[float, ...]:
    """Return for every task the sum over its calls of the least time of each, in seconds.

    The tasks take turns: every one once, then every one again. In each turn a call is made twice in a row, so
    that one finds its data in the cache; the least of all times counts.
    """
    least = [[float("inf")] * len(task.calls) for task in tasks]
    with _without_garbage_collection():
        for _ in range(turns):
            for task, times in zip(tasks, least, strict=True):
                task.prepare()
                for i, call in enumerate(task.calls):
                    times[i] = min(times[i], *(_seconds(call) for _ in range(IN_A_ROW)))
    return tuple(sum(times) for times in least)


def _seconds(call: Callable[[], object]) -> float:
    start = perf_counter()
    call()
    return perf_counter() - start


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
