"""The model "optimal-control": the least cost of x' = Ax + Bu from x0 with C x >= bound (11.21)-(11.23)."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from app.commands.labels import Labels, check_different, numbered
from app.commands.mode_band import BLANK, Band
from app.commands.model_keys import INTEGER, MATRIX, NUMBER, VECTOR, Key
from app.commands.models.labels import label_keys, labels_in
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
    **label_keys(
        {
            "x": "of the n states",
            "u": "of the m controls",
            "lambda": "of the costates",
            "eta": "of the multipliers",
        }
    ),
}
SOLVING = ("intervals",)


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Solve the optimal control problem of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    problem = StateConstrainedLQ(**{name: values[name] for name in PROBLEM if name in values})
    answer = problem.solve(**{name: values[name] for name in SOLVING if name in values})
    labels = labels_in(values)
    samples = _samples(answer, labels)
    names = samples.columns[0].names
    check_different([name for columns in samples.columns for name in columns.names])
    count = answer.switching_times.size
    return Simulation(
        headline=f"{answer.status}: cost {answer.cost:.10g}, {count} switching time{'s' * (count != 1)}",
        samples=samples,
        curves=samples,
        events=tuple(_events(answer)),
        state_names=names,
        modes=Modes(numbered("y", answer.multiplier.shape[1])),
        band=_band(answer),
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


def _band(answer: OptimalControl) -> Band | None:
    """Return when each constraint is active."""
    k = answer.multiplier.shape[1]
    if not answer.arcs or not k:
        return None
    edges = np.array([answer.t[0], *answer.switching_times, answer.t[-1]])
    states = np.array([[0 if i in arc else BLANK for i in range(k)] for arc in answer.arcs])
    return Band(numbered("constraint ", k), edges, states, ("active",))


def _samples(answer: OptimalControl, labels: Labels) -> Samples:
    kinds = (
        ("x", "state", answer.x),
        ("u", "control", answer.control),
        ("lambda", "costate", answer.costate),
        ("eta", "multiplier", answer.multiplier),
    )
    return Samples(
        "t",
        answer.t,
        tuple(
            Columns(
                symbol,
                title,
                labels.names_of(symbol, table.shape[1]),
                table,
                labels.units_of(symbol, table.shape[1]),
            )
            for symbol, title, table in kinds
        ),
        labels.time,
    )
