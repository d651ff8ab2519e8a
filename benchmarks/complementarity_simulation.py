"""How many simulations of each class of complementarity systems end, and are right?

    .venv/bin/python -m benchmarks.complementarity_simulation [CASES] [SECONDS]

For every class: how many of CASES random systems (40 if missing) were solved, refused by an error, wrong, and not
finished in SECONDS each (10 if missing), and the milliseconds of a solved one and of an event.
"""

import sys
import time
from typing import NamedTuple

import numpy as np

from benchmarks.lcs.classes import CLASSES, Case
from pricing_core.errors import NumericalError


class Count(NamedTuple):
    """How many cases of a class were solved, refused, wrong and not finished, and their times."""

    solved: int
    refused: int
    wrong: int
    unfinished: int
    seconds: float  # of those that were solved
    events: int
    first: str  # what went wrong first, and its seed


def count(name: str, cases: int, limit: float) -> Count:
    """Simulate the first cases of a class."""
    counts, seconds, events, first = {"": 0, "refused": 0, "wrong": 0, "unfinished": 0}, 0.0, 0, ""
    for seed in range(cases):
        outcome, text, spent, met = _outcome_of(CLASSES[name](np.random.default_rng(seed)), limit)
        counts[outcome] += 1
        seconds, events = seconds + spent, events + met
        if outcome and not first:
            first = f"seed {seed}: {text or outcome}"
    solved, refused, wrong, unfinished = counts.values()
    return Count(solved, refused, wrong, unfinished, seconds, events, first)


def _outcome_of(case: Case, limit: float) -> tuple[str, str, float, int]:
    start = time.perf_counter()
    try:
        run = case.run(lambda: time.perf_counter() - start > limit)
    except NumericalError as error:
        return "refused", f"{type(error).__name__}: {error}"[:150], 0.0, 0
    spent = time.perf_counter() - start
    if run.status == "interrupted":
        return "unfinished", "", 0.0, 0
    text = case.fault(run)
    return ("wrong", text, 0.0, 0) if text else ("", "", spent, len(run.events))


def main(cases: int = 40, limit: int = 10) -> None:
    """Print a line for each class."""
    titles = ("solved", "refused", "wrong", "unfinished", "ms each", "ms an event")
    print(f"{'class':38}" + "".join(f"{title:>12}" for title in titles))
    for name in CLASSES:
        found = count(name, cases, limit)
        each, event = 1e3 * found.seconds / max(found.solved, 1), 1e3 * found.seconds / max(found.events, 1)
        numbers = "".join(f"{number:12}" for number in found[:4])
        print(f"{name:38}{numbers}{each:12.1f}{event:12.2f}  {found.first}", flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
