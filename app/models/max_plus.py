"""The model "max-plus": x(k+1) = A x(k) + B u(k) with max for + and + for x, or a timed event graph."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from app.model_keys import Key
from app.simulation import Columns, Modes, Samples, Simulation
from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import ModelRun, run_model
from pricing_core.max_plus.model_schema import MODEL_SCHEMA

SCHEMA: Mapping[str, Any] = MODEL_SCHEMA
KEYS: Mapping[str, Key] = {  # read by the library
    name: Key(lambda _, value: value, key, required=name == "steps")
    for form in MODEL_SCHEMA["oneOf"]
    for name, key in form["properties"].items()
    if name != "model"
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Run the max-plus system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` let through.
    """
    run = run_model({"model": "max-plus", **values})
    if len(set(run.columns)) < len(run.columns):
        names = sorted({name for name in run.columns if run.columns.count(name) > 1})
        raise InvalidInputError("names", names, "different from k and from one another")

    def picture() -> Figure:
        from pricing_core.max_plus.model_figure import draw_model_run  # noqa: PLC0415

        return draw_model_run(run)

    samples = _samples(run)
    steps, pace = len(run.table) - 1, run.cycle_time
    slowest = f", cycle time {pace.max():.10g}" if np.isfinite(pace.max()) else ""
    return Simulation(
        headline=f"{steps} step{'s' * (steps != 1)}{slowest}",
        samples=samples,
        curves=samples,
        events=(),
        state_names=samples.columns[0].names,
        modes=Modes(()),
        facts={"steps": steps, "cycle_time": pace},
        picture=picture,
    )


def _samples(run: ModelRun) -> Samples:
    end = 1 + run.state_count
    states = Columns("x", "time", run.columns[1:end], run.states)
    outputs = Columns("y", "output", run.columns[end:], run.table[:, end:])
    return Samples("k", run.table[:, 0], (states, outputs) if outputs.names else (states,))
