"""The model "circuit": resistors, capacitors, inductors, sources, transformers and ideal diodes (11.2.1)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.commands.mode_band import Band, of_active_pairs, with_switches
from app.commands.model_keys import TEXT, VECTOR, Key
from app.commands.models.circuit_elements import ELEMENTS
from app.commands.models.method import METHOD, method_in
from app.commands.models.times import SPAN_AND_TIMES, T_SPAN, times_in
from app.commands.simulation import CURVE_POINTS, Columns, Modes, Samples, Scene, Simulation, of_samples
from pricing_core.errors import InvalidInputError, MissingInputError, Told
from pricing_core.models import CircuitRun, DiodeCircuit
from pricing_core.models.circuits.equations import GROUND
from pricing_core.models.circuits.switched_circuit import SwitchedRecord

CIRCUIT: Mapping[str, Key] = {
    "netlist": TEXT.described("in a subset of SPICE's language; either this or elements"),
    "elements": ELEMENTS.described("each with its kind, its name, the nodes that it joins and its value"),
}
KEYS: Mapping[str, Key] = {
    **CIRCUIT,
    "x0": VECTOR.described("the independent states; the elements' initial values where missing"),
    **SPAN_AND_TIMES,
    "t_span": T_SPAN.described("[start, end]; that of the netlist's .tran where missing"),
    **METHOD,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the circuit of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    return _simulated(circuit_of(values), values)


def simulate_netlist(path: Path) -> Simulation:
    """Simulate the circuit of a netlist in a file, over the time of its .tran."""
    return _simulated(DiodeCircuit.from_netlist_file(path), {})


def _simulated(circuit: DiodeCircuit, values: Mapping[str, Any]) -> Simulation:
    span = values.get("t_span", circuit.t_span)
    times = None if span is None else times_in({**values, "t_span": span})
    run = circuit.simulate(span, values.get("x0"), method=method_in(values), t_eval=times)
    simulation = of_samples(
        run.trajectory,
        _samples(run),
        _samples(run.refined(CURVE_POINTS)),
        run.circuit.state_names,
        Modes(run.circuit.slack_names),
        _band(run),
    )
    units = tuple("V" if name.startswith("v(") else "A" for name in run.circuit.state_names)
    facts = {**simulation.facts, "energy_lost_at_start": run.energy_lost_at_start}
    if circuit.notes:
        facts["notes"] = list(circuit.notes)
    return replace(
        simulation,
        orbit=None if simulation.orbit is None else replace(simulation.orbit, units=units),
        scene=partial(_scene, run, circuit, simulation.band),
        facts=facts,
    )


def circuit_of(values: Mapping[str, Any]) -> DiodeCircuit:
    """Return the circuit that a model file states.

    Parameters
    ----------
    values : mapping
        What `CIRCUIT` read.

    Raises
    ------
    InvalidInputError
        It is stated twice or not at all, or is no circuit.
    """
    stated = [name for name in CIRCUIT if name in values]
    if not stated:
        raise MissingInputError("circuit", 'give "netlist" or "elements"')
    if len(stated) > 1:
        raise InvalidInputError("circuit", Told("given twice"), 'given either as "netlist" or as "elements"')
    if "netlist" in values:
        return DiodeCircuit.from_netlist(values["netlist"])
    circuit = DiodeCircuit()
    for element in values["elements"]:
        add = getattr(circuit, element["kind"])
        add(**{name: value for name, value in element.items() if name != "kind"})
    return circuit


def _scene(run: CircuitRun, circuit: DiodeCircuit, band: Band | None) -> Scene:
    from app.commands.circuit_scene import CircuitScene  # noqa: PLC0415 - it takes matplotlib

    return CircuitScene(run.refined(CURVE_POINTS), circuit.elements, band)


def _band(run: CircuitRun) -> Band | None:
    """Return where each diode conducts: its reverse voltage is the slack and zero, or its current is and is not.

    And where each switch is closed.
    """
    slacks, circuit = run.circuit.slack_names, run.circuit
    names = [slack.partition("(")[2].rstrip(")") for slack in slacks]
    band = of_active_pairs(run.trajectory, names, "conducts", [slack.startswith("i(") for slack in slacks])
    if not isinstance(circuit, SwitchedRecord):
        return band
    switches = [switch.name for switch in circuit.circuit.switches]
    return with_switches(run.trajectory, band, switches, circuit.positions)


def _samples(run: CircuitRun) -> Samples:
    voltages = {f"v({node})": values for node, values in run.voltages.items() if node != GROUND}
    currents = {f"i({branch})": values for branch, values in run.currents.items()}
    return Samples(
        "t",
        run.t,
        tuple(
            Columns(
                symbol, title, tuple(columns), np.column_stack(list(columns.values())), (unit,) * len(columns)
            )
            for symbol, title, unit, columns in (
                ("v", "voltage", "V", voltages),
                ("i", "current", "A", currents),
            )
        ),
        unit="s",
    )
