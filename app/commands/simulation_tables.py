"""A simulation on the terminal: a short table, or JSON for programs."""

import json
import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from app.commands.simulation import ROUNDING, Modes, Samples, Simulation
from app.commands.tables import print_table
from pricing_core.lcs import Event

MOST_EVENTS = 12  # from the first on, and as many up to the last


def print_simulation(simulation: Simulation) -> None:
    """Print notes on the model, where the run ends, and its events: their times, kinds, modes and jumps."""
    samples, events, modes = simulation.samples, simulation.events, simulation.modes
    print(
        simulation.headline,
        *(f"note: {note}" for note in simulation.facts.get("notes", ())),
        sep="\n",
        end="\n\n",
    )
    if samples.points.size:
        print_table(("", f"at {samples.axis} = {samples.points[-1]:.10g}"), _last_row(samples))
    if events:
        print()
        zero = "zero " if modes.pieces is None else ""
        heads = ("t", "event", f"{zero}before", f"{zero}after", "jump")
        rows = [_event_row(event, simulation.state_names, modes, i) for i, event in enumerate(events)]
        hidden = len(rows) - 2 * MOST_EVENTS
        if hidden > 0:
            rows[MOST_EVENTS:-MOST_EVENTS] = [(f"... {hidden} more", "", "", "", "")]
        print_table(heads, rows)


def simulation_json(simulation: Simulation) -> str:
    """Return one JSON object: the axis, the columns by symbol, one row for each point, all of events, the facts."""
    samples = simulation.samples
    content: dict[str, Any] = {samples.axis: samples.points}
    content |= {columns.symbol: columns.values for columns in samples.columns}
    content["names"] = {columns.symbol: list(columns.names) for columns in samples.columns}
    content["names"]["x"] = list(simulation.state_names)  # also of x_before and x_after in events
    content["events"] = [
        _event_parts(event, simulation.modes, i) for i, event in enumerate(simulation.events)
    ]
    return json.dumps(_plain(content | dict(simulation.facts)), allow_nan=False)


def simulation_columns(simulation: Simulation) -> dict[str, list[float | None]]:
    """Return the columns of a CSV file by name."""
    samples = simulation.samples
    columns = {samples.axis: samples.points} | {
        name: kind.values[:, i] for kind in samples.columns for i, name in enumerate(kind.names)
    }
    return {name: _plain(values) for name, values in columns.items()}


def _last_row(samples: Samples) -> Iterator[tuple[str, str]]:
    for columns in samples.columns:
        sizes = np.max(np.abs(columns.values), axis=0, where=np.isfinite(columns.values), initial=0.0)
        largest = np.max(sizes, initial=0.0)
        for name, value, size in zip(columns.names, columns.values[-1], sizes, strict=True):
            shown = _without_rounding(value, largest if size <= ROUNDING * largest else size)
            yield name, f"{shown:.10g}"


def _event_parts(event: Event, modes: Modes, number: int) -> dict[str, Any]:
    parts = {part.name: getattr(event, part.name) for part in fields(event)}
    if modes.pieces is None:
        return parts
    for when, pieces in zip(("before", "after"), modes.pieces[number], strict=True):
        del parts[f"mode_{when}"]
        parts[f"pieces_{when}"] = pieces
    del parts["impulse"]  # in terms of the complementarity system
    return parts


def _event_row(event: Event, states: tuple[str, ...], modes: Modes, number: int) -> tuple[str, ...]:
    size = float(np.max(np.abs(event.x_before), initial=0.0))
    jump = [
        f"{name}: {before:.6g} -> {_without_rounding(after, size):.6g}"
        for name, before, after in zip(states, event.x_before, event.x_after, strict=True)
        if abs(after - before) > ROUNDING * size
    ]
    kind = f"{event.kind}, order-sensitive" if event.order_sensitive else event.kind
    around = (event.mode_before, event.mode_after) if modes.pieces is None else modes.pieces[number]
    words = ("?" if mode is None else modes.in_words(mode) for mode in around)
    return (f"{event.time:.10g}", kind, *words, ", ".join(jump))


def _without_rounding(value: float, size: float) -> float:
    return value if abs(value) > ROUNDING * size else 0.0


def _plain(value: Any) -> Any:
    """Return the value in JSON's own types, null for a number that is not finite."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
