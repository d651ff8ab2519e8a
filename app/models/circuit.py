"""The model "circuit": resistors, capacitors, inductors, sources, transformers and ideal diodes (11.2.1)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from app.model_keys import VECTOR, Key
from app.models.method import METHOD, method_in
from app.models.times import SPAN_AND_TIMES, times_in
from app.simulation import CURVE_POINTS, Columns, Modes, Samples, Simulation, of_samples
from pricing_core.models import CircuitRun, circuit_from_json
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.model_file import KINDS

ELEMENT = {
    "type": "object",
    "properties": {"kind": {"enum": list(KINDS)}, "name": {"type": "string"}},
    "required": ["kind", "name"],
}
CIRCUIT: Mapping[str, Key] = {  # read by the library
    "netlist": Key(lambda _, value: value, {"type": "string"}).described(
        "in a subset of SPICE's language; either this or elements"
    ),
    "elements": Key(lambda _, value: value, {"type": "array", "items": ELEMENT}).described(
        "each with its kind, its name, the nodes that it joins and its value"
    ),
}
KEYS: Mapping[str, Key] = {
    **CIRCUIT,
    "x0": VECTOR.described("the independent states; the elements' initial values where missing"),
    **SPAN_AND_TIMES,
    **METHOD,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the circuit of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    circuit = circuit_from_json(
        {"model": "circuit"} | {name: values[name] for name in CIRCUIT if name in values}
    )
    run = circuit.simulate(
        values["t_span"], values.get("x0"), method=method_in(values), t_eval=times_in(values)
    )
    simulation = of_samples(
        run.trajectory,
        _samples(run),
        _samples(run.refined(CURVE_POINTS)),
        run.circuit.state_names,
        Modes(run.circuit.slack_names),
    )
    return replace(simulation, facts={**simulation.facts, "energy_lost_at_start": run.energy_lost_at_start})


def _samples(run: CircuitRun) -> Samples:
    voltages = {f"v({node})": values for node, values in run.voltages.items() if node != GROUND}
    currents = {f"i({branch})": values for branch, values in run.currents.items()}
    return Samples(
        "t",
        run.t,
        tuple(
            Columns(symbol, title, tuple(columns), np.column_stack(list(columns.values())))
            for symbol, title, columns in (("v", "voltage (V)", voltages), ("i", "current (A)", currents))
        ),
    )
