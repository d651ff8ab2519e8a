"""The model "mechanics": M q'' + D q' + K q = F^T u + force, 0 <= y = F q + offset _|_ u >= 0 (11.85)-(11.87)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from app.commands.labels import Labels, check_different, numbered
from app.commands.mode_band import Band, of_contacts
from app.commands.model_keys import (
    MATRIX,
    NUMBER,
    VECTOR,
    Key,
    array_schema,
    choice,
)
from app.commands.models.boxes import BOXES, with_boxes
from app.commands.models.drawing import KEY as DRAWING
from app.commands.models.drawing import check_drawing
from app.commands.models.inputs import INPUT
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import CURVE_POINTS, Columns, Modes, Samples, Scene, Simulation, of_samples
from pricing_core.lcs import Trajectory
from pricing_core.models import ContactTrajectory, MechanicalSystem

TANGENT_ROWS = Key(
    lambda field, value: (
        [MATRIX.read(f"{field}[{i}]", part) for i, part in enumerate(value)]
        if isinstance(value, list)
        and value
        and isinstance(value[0], list)
        and value[0]
        and isinstance(value[0][0], list)
        else MATRIX.read(field, value)
    ),
    {"anyOf": [MATRIX.schema, array_schema(MATRIX.schema)]},
)
TANGENTS = (
    "k x n, by rows: the tangent of each contact in the plane; or for each contact m x n: directions in space"
)
SYSTEM: Mapping[str, Key] = {
    "mass": MATRIX.described("n x n, by rows, symmetric and positive definite", required=True),
    "damping": MATRIX.described("n x n, by rows; zero where missing"),
    "stiffness": MATRIX.described("n x n, by rows; zero where missing"),
    "F": MATRIX.described("k x n, by rows", required=True),
    "force": INPUT.described("n numbers or an input that changes; zero where missing"),
    "offset": VECTOR.described("k numbers; zero where missing"),
    "restitution": NUMBER.described("from 0, where missing, to 1"),
    "tangents": TANGENT_ROWS.described(TANGENTS),
    "friction": VECTOR.described("k coefficients; given together with tangents, for time stepping"),
}
NAMES = {"q": "of the n coordinates", "contacts": "of the k constraints"}
UNITS = {
    "q": "of the coordinates",
    "v": "of velocities",
    "y": "of gaps",
    "u": "of forces",
    "slip": "of slip velocities",
}
SCHEMES = choice("auto", "implicit-euler", "sdirk2", "theta", "moreau", "stewart-trinkle").described(
    "of time stepping; auto is moreau with friction or restitution"
)
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "q0": VECTOR.described("n numbers: the position at the start", required=True),
    "v0": VECTOR.described("n numbers: the velocity at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
    "scheme": SCHEMES,
    **label_keys(NAMES, UNITS),
    "drawing": DRAWING,
}
FORMS = {"mechanics": KEYS, "mechanics of boxes": {**BOXES, **SPAN_AND_TIMES, **METHOD, "scheme": SCHEMES}}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the mechanical system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read, or the keys of boxes.
    """
    values = with_boxes(values) if "boxes" in values else values
    given = {name: values[name] for name in SYSTEM if name in values}
    n, k = len(given["mass"]), len(given["F"])
    at_rest = {name: [[0] * n] * n for name in ("damping", "stiffness")}
    system, labels, drawing = MechanicalSystem(**at_rest | given), labels_in(values), values.get("drawing")
    contacts = labels.names_of("contacts", k, numbered("contact ", k))
    check_drawing(drawing, labels.names_of("q", n))
    run = system.simulate(
        values["q0"], values["v0"], values["t_span"], method=method_in(values), t_eval=times_in(values)
    )

    def samples(at: Trajectory) -> Samples:
        return Samples("t", at.t, _kinds(at, labels), labels.time)

    rows, curves = samples(run), samples(run.refined(CURVE_POINTS))
    check_different([name for columns in rows.columns for name in columns.names])
    positions, velocities, *_, gaps = rows.columns
    band = of_contacts(run, contacts)
    simulation = of_samples(run, rows, curves, positions.names + velocities.names, Modes(gaps.names), band)
    return replace(simulation, scene=partial(_scene, curves, band, drawing))


def _scene(curves: Samples, band: Band | None, drawing: Mapping[str, Any] | None) -> Scene:
    from app.commands.mechanics_scene import BodyScene, TrackScene  # noqa: PLC0415 - it takes matplotlib

    if drawing is None:
        return TrackScene(curves.points, [kind for kind in curves.columns if kind.symbol in ("q", "y")], band)
    places = curves.columns[0]
    by_name = dict(zip(places.names, places.values.T, strict=True))
    return BodyScene(curves.points, by_name, drawing["bodies"], drawing.get("slope", 0.0))


def _kinds(run: Trajectory, labels: Labels) -> tuple[Columns, ...]:
    n, k = run.x.shape[1] // 2, run.u.shape[1]
    named = "q" in labels.names
    coordinates = labels.names_of("q", n)
    velocities = tuple(f"{name}'" for name in coordinates) if named else numbered("v", n)
    lengths = labels.units_of("q", n)
    rates = labels.units_of("v", n, [_rate(unit, labels.time) for unit in lengths])
    kinds = [
        Columns("q", "position", coordinates, run.x[:, :n], lengths),
        Columns("v", "velocity", velocities, run.x[:, n:], rates),
        Columns("u", "contact force", _of_contacts(labels, "u", "force", k), run.u, labels.units_of("u", k)),
    ]
    if isinstance(run, ContactTrajectory) and run.friction_force.size:
        kinds += _along_tangents(run, labels, k)
    kinds.append(Columns("y", "gap", _of_contacts(labels, "y", "gap", k), run.y, labels.units_of("y", k)))
    return tuple(kinds)


def _along_tangents(run: ContactTrajectory, labels: Labels, k: int) -> list[Columns]:
    each = run.friction_force.shape[2] if run.friction_force.ndim == 3 else 1
    suffixes = [f".{j + 1}" for j in range(each)] if run.friction_force.ndim == 3 else [""]
    kinds = []
    for symbol, title, unit, table in (
        ("friction", "friction force", "u", run.friction_force),
        ("slip", "slip velocity", "slip", run.slip),
    ):
        of_contacts = _of_contacts(labels, symbol, symbol, k)
        names = tuple(f"{name}{suffix}" for name in of_contacts for suffix in suffixes)
        values = table.reshape(run.t.size, k * each)
        kinds.append(Columns(symbol, title, names, values, labels.units_of(unit, k * each)))
    return kinds


def _of_contacts(labels: Labels, symbol: str, word: str, k: int) -> tuple[str, ...]:
    if "contacts" not in labels.names:
        return numbered(symbol, k)
    return tuple(f"{word} {name}" for name in labels.names_of("contacts", k))


def _rate(unit: str, time: str) -> str:
    return f"{unit}/{time}" if unit and time else ""
