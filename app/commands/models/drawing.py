"""The key "drawing" of a mechanical system: the bodies that its animation shows."""

from collections.abc import Mapping, Sequence
from typing import Any

from app.commands.model_keys import NUMBER, TEXT, choice, list_of, object_of
from pricing_core.errors import InvalidInputError, MissingInputError

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
KEY = object_of(DRAWING).described("what an animation shows; points on tracks where missing")


def check_drawing(drawing: Mapping[str, Any] | None, coordinates: Sequence[str]) -> None:
    """Raise InvalidInputError where a body lacks its size, or moves with something that is no coordinate."""
    for i, body in enumerate(drawing["bodies"] if drawing else ()):
        field = f"drawing.bodies[{i}]"
        for name in ("radius",) if body["shape"] == "disc" else ("width", "height"):
            if name not in body:
                raise MissingInputError(f"{field}.{name}", f"a {body['shape']} needs it")
            if body[name] <= 0.0:
                raise InvalidInputError(f"{field}.{name}", body[name], "> 0")
        for name in ("x", "y", "turn"):
            if name in body and body[name] not in coordinates:
                raise InvalidInputError(f"{field}.{name}", body[name], "one of " + ", ".join(coordinates))
