"""The second form of the model "mechanics": boxes on a plane and on each other, by their sizes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.commands.model_keys import NUMBER, VECTOR, Key, object_of
from pricing_core.errors import InvalidInputError
from pricing_core.models import MechanicalSystem, box_stack

SIZES: Mapping[str, Key] = {
    "mass": VECTOR.described("of each box, from below", required=True),
    "width": VECTOR.described("of each box", required=True),
    "height": VECTOR.described("of each box", required=True),
    "friction": VECTOR.described("coefficient below each box", required=True),
    "slope": NUMBER.described("angle of the plane in radians, downhill to the right; 0 where missing"),
    "gravity": NUMBER.described("9.81 where missing"),
    "restitution": NUMBER.described("from 0, where missing, to 1"),
}
BOXES: Mapping[str, Key] = {
    "boxes": object_of(SIZES).described("that stand on each other, in kilograms and metres", required=True),
    "q0": VECTOR.described("x, y and rotation of each box: how it is off its place; 0 where missing"),
    "v0": VECTOR.described("the velocities at the start; 0 where missing"),
}


def with_boxes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same model stated without boxes: the system, names, units and the drawing.

    Parameters
    ----------
    values : mapping
        What `BOXES` and the keys of times and methods read.
    """
    sizes = values["boxes"]
    try:
        system: MechanicalSystem = box_stack(**sizes)
    except InvalidInputError as fault:
        raise fault.called(f"boxes.{fault.field}") from None
    count = len(sizes["mass"])
    numbers = [str(i + 1) for i in range(count)] if count > 1 else [""]
    names = [[f"{word}{number}" for word in ("x", "y", "turn")] for number in numbers]
    heights = np.array(sizes["height"], dtype=np.float64)
    middles = np.cumsum(heights) - 0.5 * heights
    bodies = [
        {"shape": "box", "width": width, "height": height, "at": [0.0, middle], "x": x, "y": y, "turn": turn}
        for width, height, middle, (x, y, turn) in zip(
            sizes["width"], sizes["height"], middles.tolist(), names, strict=True
        )
    ]
    still = [0] * (3 * count)
    return {
        "q0": still,
        "v0": still,
        **{name: value for name, value in values.items() if name != "boxes"},
        "mass": system.mass,
        "stiffness": system.stiffness,
        "F": system.F,
        "force": system.force,
        "restitution": system.restitution,
        "tangents": system.tangents,
        "friction": system.friction,
        "names": {
            "q": [name for triple in names for name in triple],
            "contacts": [f"{side}{number}" for number in numbers for side in ("left", "right")],
        },
        "units": {"t": "s", "q": ["m", "m", "rad"] * count, "u": "N", "y": "m", "slip": "m/s"},
        "drawing": {"bodies": bodies, "slope": sizes.get("slope", 0.0)},
    }
