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
    TEXT,
    VECTOR,
    Key,
    array_schema,
    choice,
    list_of,
    object_of,
)
from app.commands.models.inputs import INPUT
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import CURVE_POINTS, Columns, Modes, Samples, Scene, Simulation, of_samples
from pricing_core.errors import InvalidInputError, Told
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
NAME = TEXT.described("the name of a coordinate, as in names, or q1, q2, ...")
BODY = {
    "shape": choice("box", "disc").described("what it looks like", required=True),
    "width": NUMBER.described("of a box"),
    "height": NUMBER.described("of a box"),
    "radius": NUMBER.described("of a disc"),
    "at": list_of(NUMBER, "two numbers", minItems=2, maxItems=2).described(
        "its middle where the coordinates are 0; the floor is at height 0", required=True
    ),
    "x": NAME,
    "y": NAME,
    "turn": NAME,
}
DRAWING = {
    "bodies": list_of(object_of(BODY), "a list of bodies", minItems=1).described(
        "boxes and discs", required=True
    ),
    "slope": NUMBER.described("angle of the floor in radians, downhill to the right; 0 where missing"),
}
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "q0": VECTOR.described("n numbers: the position at the start", required=True),
    "v0": VECTOR.described("n numbers: the velocity at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
    "scheme": SCHEMES,
    **label_keys(NAMES, UNITS),
    "drawing": object_of(DRAWING).described("what an animation shows; points on tracks where missing"),
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the mechanical system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    given = {name: values[name] for name in SYSTEM if name in values}
    n = len(given["mass"])
    at_rest = {name: [[0] * n] * n for name in ("damping", "stiffness")}
    run = MechanicalSystem(**at_rest | given).simulate(
        values["q0"], values["v0"], values["t_span"], method=method_in(values), t_eval=times_in(values)
    )
    kinds = _kinds(run, labels_in(values))
    check_different([name for columns in kinds for name in columns.names])

    def samples(at: Trajectory) -> Samples:
        return Samples("t", at.t, _kinds(at, labels_in(values)), labels_in(values).time)

    states, modes = kinds[0].names + kinds[1].names, Modes(next(c.names for c in kinds if c.symbol == "y"))
    contacts = labels_in(values).names_of("contacts", run.u.shape[1], numbered("contact ", run.u.shape[1]))
    band = of_contacts(run, contacts)
    curves = samples(run.refined(CURVE_POINTS))
    simulation = of_samples(run, samples(run), curves, states, modes, band)
    drawing = values.get("drawing")
    _check_drawing(drawing, kinds[0].names)
    return replace(simulation, scene=partial(_scene, curves, band, drawing))


def _check_drawing(drawing: Mapping[str, Any] | None, coordinates: tuple[str, ...]) -> None:
    """Raise InvalidInputError where a body lacks its size, or moves with something that is no coordinate."""
    for i, body in enumerate(drawing["bodies"] if drawing else ()):
        field = f"drawing.bodies[{i}]"
        for name in ("radius",) if body["shape"] == "disc" else ("width", "height"):
            if name not in body:
                raise InvalidInputError(f"{field}.{name}", Told("missing"), f"given for a {body['shape']}")
            if body[name] <= 0.0:
                raise InvalidInputError(f"{field}.{name}", body[name], "> 0")
        for name in ("x", "y", "turn"):
            if name in body and body[name] not in coordinates:
                raise InvalidInputError(f"{field}.{name}", body[name], "one of " + ", ".join(coordinates))


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
