"""Frictional contact: how far from closed forms at equal steps, in what time, beside Siconos' Moreau-Jean scheme?

    .venv/bin/python -m benchmarks.friction

For each problem and step: the largest error of the positions at the end, in shares of the distance that counts there,
the milliseconds of a step, and by how much the energy grew at most in a step, in shares of what there was. Siconos runs
where PRICING_SICONOS_PYTHON names a Python that has `siconos.kernel` (on Debian the package python3-siconos).
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.lcs.contact_problems import Problem, problems
from pricing_core.arrays import Matrix
from pricing_core.lcs import TimeStepping

PEER = Path(__file__).parent / "lcs" / "siconos_contacts.py"
STEPS = (1e-2, 1e-3)
OURS: tuple[Literal["moreau", "stewart-trinkle"], ...] = ("moreau", "stewart-trinkle")


def by_siconos(cases: list[tuple[Problem, float]]) -> list[tuple[Matrix, float]] | None:
    """Return states and seconds of Siconos, None where PRICING_SICONOS_PYTHON names no Python that has it."""
    python = os.environ.get("PRICING_SICONOS_PYTHON")
    if python is None:
        return None
    given: dict[str, object] = {"count": len(cases)}
    for k, (problem, h) in enumerate(cases):
        system, n = problem.system, problem.q0.size
        assert system.tangents is not None
        assert system.friction is not None
        parts = {
            "mass": system.mass,
            "stiffness": system.stiffness,
            "damping": system.damping,
            "force": system.force.after(0.0),
            "normals": system.F,
            "tangents": system.tangents.reshape(-1, n),
            "offset": system.offset,
            "friction": system.friction,
            "restitution": system.restitution,
            "q0": problem.q0,
            "v0": problem.v0,
            "end": problem.end,
            "h": h,
        }
        given |= {f"{name}_{k}": part for name, part in parts.items()}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "problems.npz", Path(folder) / "answers.npz"
        np.savez(source, **given)  # type: ignore[arg-type]
        subprocess.run([python, PEER, source, target], check=True, stdout=subprocess.DEVNULL)
        answers = np.load(target)
        return [(answers[f"x_{k}"], float(answers[f"seconds_{k}"])) for k in range(len(cases))]


def by_us(
    problem: Problem, h: float, scheme: Literal["moreau", "stewart-trinkle"]
) -> tuple[Matrix, float] | None:
    """Return the states and seconds of this library; None where the scheme has no restitution."""
    if scheme == "stewart-trinkle" and problem.system.restitution > 0.0:
        return None
    begin = time.perf_counter()
    run = problem.system.simulate(
        problem.q0, problem.v0, (0.0, problem.end), method=TimeStepping(scheme, step=h)
    )
    return run.x, time.perf_counter() - begin


def line(problem: Problem, h: float, name: str, found: tuple[Matrix, float]) -> str:
    """Return the printed line of one run."""
    x, seconds = found
    n, system = problem.q0.size, problem.system
    # Siconos takes whole steps: its last state may lie beside the end.
    at_end = x[-1, :n] + (problem.end - h * (len(x) - 1)) * x[-1, n:] * (name == "Siconos")
    error = np.abs(at_end - problem.q_end).max() / problem.size
    force = system.force.after(0.0)
    energy = np.array([system.energy(state[:n], state[n:]) - force @ state[:n] for state in x])
    grown = np.diff(energy).max() / max(np.ptp(energy), 1e-300)
    return f"{problem.name:34}{h:8.0e}  {name:18}{error:10.1e}{1e3 * seconds / len(x):10.2f}{max(grown, 0.0):10.1e}"


def main() -> None:
    """Print a line for each problem, step and method."""
    print(f"{'problem':34}{'step':>8}  {'method':18}{'error':>10}{'ms a step':>10}{'growth':>10}")
    cases = [(problem, h) for problem in problems() for h in STEPS]
    peers = by_siconos(cases)
    for k, (problem, h) in enumerate(cases):
        for scheme in OURS:
            found = by_us(problem, h, scheme)
            if found is not None:
                print(line(problem, h, scheme, found))
        if peers is not None:
            print(line(problem, h, "Siconos", peers[k]))
    if peers is None:
        print("Siconos did not run: PRICING_SICONOS_PYTHON names no Python that has it.")


if __name__ == "__main__":
    main()
