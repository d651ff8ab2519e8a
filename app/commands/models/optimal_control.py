"""The model "optimal-control": the least cost of x' = Ax + Bu from x0 with C x >= bound (11.21)-(11.23)."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from app.commands.labels import numbered
from app.commands.model_keys import INTEGER, MATRIX, NUMBER, VECTOR, Key
from app.commands.simulation import Columns, Modes, Samples, Simulation
from pricing_core.lcs import Event
from pricing_core.lcs.trajectory import EventKind
from pricing_core.models import OptimalControl, StateConstrainedLQ

PROBLEM: Mapping[str, Key] = {
    "A": MATRIX.described("n x n, by rows", required=True),
    "B": MATRIX.described("n x m, by rows", required=True),
    "C": MATRIX.described("k x n, by rows: C x >= bound", required=True),
    "Q": MATRIX.described("n x n, by rows: the cost is (1/2) int x^T Q x + u^T u", required=True),
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    "horizon": NUMBER.described("> 0: the time the cost is counted for", required=True),
    "bound": VECTOR.described("k numbers; zero where missing"),
}
KEYS: Mapping[str, Key] = {
    **PROBLEM,
    "intervals": INTEGER.described("of the collocation that finds the structure; 200 where missing"),
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Solve the optimal control problem of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    problem = StateConstrainedLQ(**{name: values[name] for name in PROBLEM if name in values})
    answer = problem.solve(**{name: values[name] for name in KEYS if name in values and name not in PROBLEM})
    samples, names = _samples(answer), numbered("x", answer.x.shape[1])
    count = answer.switching_times.size
    return Simulation(
        headline=f"{answer.status}: cost {answer.cost:.10g}, {count} switching time{'s' * (count != 1)}",
        samples=samples,
        curves=samples,
        events=tuple(_events(answer)),
        state_names=names,
        modes=Modes(numbered("y", answer.multiplier.shape[1])),
        facts={
            "status": answer.status,
            "cost": answer.cost,
            "residual": answer.residual,
            "multiplier_atoms": [
                {"time": time, "weights": weights} for time, weights in answer.multiplier_atoms
            ],
        },
    )


def _events(answer: OptimalControl) -> Iterator[Event]:
    """Yield junctions, with the constraints that are active before and after, and touch points."""
    atoms, nothing = dict(answer.multiplier_atoms), np.zeros(answer.multiplier.shape[1])
    arcs = zip(answer.switching_times.tolist(), answer.arcs, answer.arcs[1:], strict=False)
    for time, before, after in arcs:
        x = answer.x[int(np.searchsorted(answer.t, time))]
        kind: EventKind = "grazing" if before == after else "switch"
        yield Event(time, kind, x, x, atoms.get(time, nothing), before, after)


def _samples(answer: OptimalControl) -> Samples:
    n, m, k = answer.x.shape[1], answer.control.shape[1], answer.multiplier.shape[1]
    return Samples(
        "t",
        answer.t,
        (
            Columns("x", "state", numbered("x", n), answer.x),
            Columns("u", "control", numbered("u", m), answer.control),
            Columns("lambda", "costate", numbered("lambda", n), answer.costate),
            Columns("eta", "multiplier", numbered("eta", k), answer.multiplier),
        ),
    )
