"""What does a simulation cost for a given accuracy, beside Siconos and nosnoc on the same problems?

    .venv/bin/python -m benchmarks.simulation_peers FOLDER [quick]

A report with a table and a figure. Siconos runs where the environment variable PRICING_SICONOS_PYTHON names a Python
that has `siconos.kernel` (on Debian the package `python3-siconos`, for the system's Python), nosnoc where
PRICING_NOSNOC_PYTHON names one that has `nosnoc`; without them the report says what is missing.
"""

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from benchmarks.lcs.peer_problems import beads, dry_friction, regulated_converter
from benchmarks.lcs.problems import KnownProblem, diode_bridge, filtered_bridge, two_relays
from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.reporting.files import write_report
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table
from pricing_core.arrays import Matrix
from pricing_core.errors import NumericalError
from pricing_core.lcs import EventDriven, TimeStepping, simulate

HERE = Path(__file__).parent / "lcs"
# Matrices of a few rows gain nothing from threads, which wait for each other where other work fills the cores.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
LIMIT = 120.0  # seconds that a peer may take for one run
REFERENCES = ("regulated converter",)  # where the reference is our own run from event to event
LONG = 2.0  # seconds from which on one of our runs is timed once
LEAST_ERROR = 1e-16  # what an error of zero is drawn at
EVENT_DRIVEN = "event-driven"
# Steps for each problem, the times of which they hit; theta of Siconos; those of the quick run come first.
STEPS = {
    "diode bridge": (2e-6, 1e-6, 2e-7),
    "bridge with filter": (2e-7, 1e-7, 2e-8),
    "two relays": (1e-2, 1e-3, 2e-4),
    "dry friction": (1e-2, 2e-3, 5e-4),
    "regulated converter": (1e-9, 5e-10, 2.5e-10),
    "beads": (1e-3, 1e-4, 2e-5),
}
THETA = {"diode bridge": 0.5}
PROBLEMS: Mapping[str, Callable[[], KnownProblem]] = {
    "diode bridge": diode_bridge,
    "bridge with filter": filtered_bridge,
    "two relays": two_relays,
    "dry friction": dry_friction,
    "regulated converter": regulated_converter,
}
RELAYS = {
    "two relays": ([[0, 0], [0, 0]], [[1.0, -2.0], [2.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]]),
    "dry friction": ([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[0.0, 1.0]]),
}
ELEMENTS = {
    "two relays": (19, 38),
    "dry friction": (16, 40, 80),
}  # steps of nosnoc, of two finite elements each


class PeerRun(NamedTuple):
    """One simulation: who, with what step, how long, how far off; None where it gave no answer, and why."""

    problem: str
    method: str
    step: float | None
    seconds: float | None
    error: float | None
    remark: str = ""


def main(folder: str, mode: str = "full") -> None:
    """Write the report, and print its table."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    report = run(quick=mode == "quick")
    for row in report.sections[0].tables[0].rows:
        print(
            "  ".join(
                "" if cell is None else f"{cell:.3g}" if isinstance(cell, float) else str(cell)
                for cell in row
            )
        )
    for path in write_report(report, target):
        print("wrote", path)


def run(*, quick: bool) -> Report:
    """Simulate every problem by every method that is there."""
    count = 1 if quick else None
    runs: list[PeerRun] = []
    for name, make in PROBLEMS.items():
        runs += _of_system(make(), STEPS[name][:count], ELEMENTS.get(name, ())[:count])
    runs += _of_beads(STEPS["beads"][:count])
    missing = [name for name, key in _PYTHONS.items() if not os.environ.get(key)]
    panels = {
        name: {
            method: [
                (1e3 * one.seconds, max(one.error, LEAST_ERROR))
                for one in runs
                if (one.problem, one.method) == (name, method)
                and one.error is not None
                and one.seconds is not None
            ]
            for method in dict.fromkeys(one.method for one in runs)
        }
        for name in STEPS
    }
    text = f"""
        Errors are the largest at a few times, as fractions of the natural size of each state: against closed forms,
        but for the regulated converter of Siconos' examples, whose reference is our run from event to event; the others
        approach it as their steps shrink. Ours are the chapter's implicit Euler steps, second-order steps, Moreau's
        steps for the beads, all of constant length, and the runs from event to event. Siconos takes the same steps by
        EulerMoreauOSI and MoreauJeanOSI, on one thread. Of nosnoc the time of its solver counts, without that of
        building it.

        {"Not installed here: " + ", ".join(missing) + "." if missing else "All peers were installed."}

        {" ".join(_sentence(name, [r for r in runs if r.problem == name]) for name in STEPS)}
        """
    figures = {"peers": curves(panels, "milliseconds", "error")}
    section = Section("Work and precision", text, (table("runs", runs),), figures)
    title = "Simulation beside Siconos and nosnoc: error against time"
    question = "What does a simulation cost for a given accuracy, beside Siconos and nosnoc?"
    return Report("simulation-peers", title, question, (section,))


def _of_system(problem: KnownProblem, steps: Sequence[float], elements: Sequence[int]) -> list[PeerRun]:
    span = (0.0, float(problem.times[-1]))

    def states(method: EventDriven | TimeStepping) -> Matrix:
        return simulate(problem.system, problem.x0, span, method=method, t_eval=problem.times).x

    runs = [_ours(problem.name, EVENT_DRIVEN, None, partial(states, EventDriven()), problem.error)]
    for scheme in problem.schemes:
        for h in steps:
            stepped = partial(states, TimeStepping(scheme, step=h))
            runs.append(_ours(problem.name, scheme, h, stepped, problem.error))
    for h in steps:
        given = _for_siconos(problem, h)
        runs.append(_peer(problem.name, "Siconos", h, given, problem.error))
    for count in elements:
        A, B, C = RELAYS[problem.name]
        h = span[1] / count
        given = {
            "A": A,
            "B": B,
            "C": C,
            "x0": problem.x0,
            "times": problem.times,
            "h": h,
            "steps": count,
            "stages": 2,
        }
        runs.append(_peer(problem.name, "nosnoc", h / 2.0, given, problem.error))
    return runs


def _of_beads(steps: Sequence[float]) -> list[PeerRun]:
    column = beads()
    exact, system = column.exact, column.system()
    span, times = (0.0, float(column.times[-1])), column.times

    def error(x: Matrix) -> float:
        return float(np.abs(x - exact).max())

    def states(method: Any) -> Matrix:
        found = system.simulate(column.heights, column.velocities, span, method=method, t_eval=times)
        return np.asarray(found.x)

    runs = [_ours("beads", EVENT_DRIVEN, None, partial(states, EVENT_DRIVEN), error)]
    for h in steps:
        runs.append(_ours("beads", "moreau", h, partial(states, TimeStepping("moreau", step=h)), error))
    for h in steps:
        places = np.round(times / h).astype(int)
        given = {
            "F": column.gaps,
            "q0": column.heights,
            "v0": column.velocities,
            "weight": np.full(column.heights.size, -column.gravity),
            "restitution": column.restitution,
            "h": h,
            "steps": int(places[-1]),
            "wanted": places,
        }
        runs.append(_peer("beads", "Siconos", h, given, error))
    return runs


def _for_siconos(problem: KnownProblem, h: float) -> dict[str, Any]:
    """Return the system and its inputs at the ends of all steps, one row where they are constant."""
    system, places = problem.system, np.round(problem.times / h).astype(int)
    steps = int(places[-1])
    constant = not (system.f.jumps.size or system.g.jumps.size)
    times = h * np.arange(1 if constant else steps + 1)
    return {
        **{name: getattr(system, name) for name in "ABCD"},
        "x0": problem.x0,
        "b": np.array([system.f.after(t) for t in times]),
        "e": np.array([system.g.after(t) for t in times]),
        "h": h,
        "steps": steps,
        "wanted": places,
        "theta": THETA.get(problem.name, 1.0),
    }


def _ours(
    problem: str,
    method: str,
    step: float | None,
    call: Callable[[], Matrix],
    error: Callable[[Matrix], float],
) -> PeerRun:
    begin = perf_counter()
    try:
        found = call()
    except NumericalError as fault:
        return PeerRun(problem, method, step, None, None, f"{type(fault).__name__}: {fault}"[:120])
    seconds = perf_counter() - begin
    if seconds < LONG:
        (seconds,) = least_seconds([Task((call,))], turns=1)
    return PeerRun(problem, method, step, seconds, error(found))


_PYTHONS = {"Siconos": "PRICING_SICONOS_PYTHON", "nosnoc": "PRICING_NOSNOC_PYTHON"}
_SCRIPTS = {"Siconos": "siconos_steps.py", "nosnoc": "nosnoc_steps.py"}


def _peer(
    problem: str, peer: str, step: float, given: Mapping[str, Any], error: Callable[[Matrix], float]
) -> PeerRun:
    python = os.environ.get(_PYTHONS[peer])
    if not python:
        return PeerRun(problem, peer, step, None, None, "not installed")
    with tempfile.TemporaryDirectory() as folder:
        asked, answer = Path(folder) / "problem.npz", Path(folder) / "answer.npz"
        np.savez(asked, **{name: np.asarray(value) for name, value in given.items()})  # type: ignore[arg-type]
        command = [python, str(HERE / _SCRIPTS[peer]), str(asked), str(answer)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=LIMIT,
                check=False,
                env=os.environ | ONE_THREAD,
            )
        except subprocess.TimeoutExpired:
            return PeerRun(problem, peer, step, None, None, f"not in {LIMIT:g} s")
        if done.returncode or not answer.exists():
            lines = done.stderr.strip().splitlines() or [f"ended with {done.returncode}"]
            return PeerRun(problem, peer, step, None, None, lines[-1][:120])
        found = np.load(answer)
        missed = error(found["x"])
        remark = "" if math.isfinite(missed) else "no number"
        return PeerRun(problem, peer, step, float(found["seconds"]), missed if not remark else None, remark)


def _sentence(name: str, runs: Sequence[PeerRun]) -> str:
    driven, *others = runs
    answered = [r for r in others if r.error is not None and r.seconds is not None]
    if driven.error is None or not answered:
        return f"{name.capitalize()}: no comparison."
    parts = []
    for method in dict.fromkeys(r.method for r in answered):
        best = min((r for r in answered if r.method == method), key=lambda r: r.error or 0.0)
        parts.append(f"{method} {1e3 * (best.seconds or 0.0):,.0f} ms for {best.error:.1e}")
    accuracy = "the reference itself" if name in REFERENCES else f"for {driven.error:.1e}"
    first = f"from event to event {1e3 * (driven.seconds or 0.0):,.1f} ms, {accuracy}"
    return f"{name.capitalize()}: {first}; at best {', '.join(parts)}."


if __name__ == "__main__":
    main(*sys.argv[1:])
