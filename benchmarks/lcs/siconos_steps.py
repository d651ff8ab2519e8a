"""Run by Siconos' own Python: simulate a problem by its time stepping, and write the states, steps and seconds.

The problem is a file of NumPy: for a linear complementarity system A, B, C, D, x0, and the tables b and e of the
inputs at the ends of the steps (or one row); for beads their gaps F, heights and velocities, weight and restitution.
"""

import importlib
import sys
import time
from typing import Any

import numpy as np

LONG = 2.0  # seconds


def main(problem: str, answer: str) -> None:
    """Read a problem, and write the answer to another file."""
    kernel = importlib.import_module("siconos.kernel")
    given = dict(np.load(problem))
    run = _beads if "F" in given else _system
    seconds = float("inf")
    for _ in range(3):  # the least time counts, as for ours; long runs are made once
        begin = time.perf_counter()
        x = run(kernel, given)
        seconds = min(seconds, time.perf_counter() - begin)
        if seconds > LONG:
            break
    np.savez(answer, x=x, seconds=seconds)


def _system(kernel: Any, given: dict[str, Any]) -> np.ndarray[Any, Any]:
    h, steps, wanted = float(given["h"]), int(given["steps"]), set(given["wanted"].tolist())
    x0 = given["x0"].copy()
    system = kernel.FirstOrderLinearDS(x0, given["A"].copy())
    b, e = given["b"], given["e"]
    system.setbPtr(b[0].copy())
    relation = kernel.FirstOrderLinearTIR(given["C"].copy(), given["B"].copy())
    relation.setDPtr(given["D"].copy())
    relation.setePtr(e[0].copy())
    interaction = kernel.Interaction(kernel.ComplementarityConditionNSL(given["C"].shape[0]), relation)
    model = kernel.NonSmoothDynamicalSystem(0.0, h * (steps + 2))
    model.insertDynamicalSystem(system)
    model.link(interaction, system)
    scheme = kernel.EulerMoreauOSI(float(given["theta"]))
    stepping = kernel.TimeStepping(model, kernel.TimeDiscretisation(0.0, h), scheme, kernel.LCP())
    rows, x = [], system.x()
    for k in range(1, steps + 1):
        if len(b) > 1:
            system.b()[:], relation.e()[:] = b[k], e[k]
        stepping.computeOneStep()
        if k in wanted:
            rows.append(np.array(x))
        stepping.nextStep()
    return np.array(rows)


def _beads(kernel: Any, given: dict[str, Any]) -> np.ndarray[Any, Any]:
    h, steps, wanted = float(given["h"]), int(given["steps"]), set(given["wanted"].tolist())
    q, v, F = given["q0"].copy(), given["v0"].copy(), given["F"]
    system = kernel.LagrangianLinearTIDS(q, v, np.eye(q.size))
    system.setFExtPtr(given["weight"].copy())
    model = kernel.NonSmoothDynamicalSystem(0.0, h * (steps + 2))
    model.insertDynamicalSystem(system)
    law = kernel.NewtonImpactNSL(float(given["restitution"]))
    kept = []
    for row in F:
        relation = kernel.LagrangianLinearTIR(row[None].copy())
        interaction = kernel.Interaction(law, relation)
        model.link(interaction, system)
        kept.append((relation, interaction))
    scheme = kernel.MoreauJeanOSI(0.5)
    stepping = kernel.TimeStepping(model, kernel.TimeDiscretisation(0.0, h), scheme, kernel.LCP())
    rows = []
    for k in range(1, steps + 1):
        stepping.computeOneStep()
        if k in wanted:
            rows.append(np.concatenate([system.q(), system.velocity()]))
        stepping.nextStep()
    return np.array(rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
