"""Characteristics of model files: by points or by name, and what is refused with its key."""

import math
from typing import Any

import pytest

from app.commands.models.characteristics import CHARACTERISTICS
from pricing_core.errors import InvalidInputError
from pricing_core.models import Characteristic
from tests.problems.bad_values import WRONG


def read(entry: Any) -> Characteristic:
    (curve,) = CHARACTERISTICS.read("curves", [entry])
    assert isinstance(curve, Characteristic)
    return curve


@pytest.mark.parametrize(
    ("entry", "points", "slopes"),
    [
        ({"relay_step": {}}, [[0, 1], [0, -1]], (0, 0)),
        ({"coulomb_friction": {"level": 2, "viscosity": 0.5}}, [[0, 2], [0, -2]], (-0.5, -0.5)),
        ({"ideal_diode": {}}, [[0, 0]], (-math.inf, 0)),
        ({"points": [[1, 0]], "left_slope": 0, "right_slope": "inf"}, [[1, 0]], (0, math.inf)),
        ({"gain_schedule": {"thresholds": [1], "gains": [1, 2]}}, [[1, 1]], (1, 2)),
        (
            {
                "resistor": {
                    "voltages": [0, 1],
                    "currents": [0, 1],
                    "left_conductance": 0,
                    "right_conductance": 2,
                }
            },
            [[0, 0], [1, 1]],
            (0, 2),
        ),
    ],
)
def test_characteristics_have_points_or_a_name(
    entry: Any, points: list[list[float]], slopes: tuple[float, float]
) -> None:
    curve = read(entry)
    assert curve.points.tolist() == points
    assert (curve.left_slope, curve.right_slope) == slopes


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (3, r'curves[0] = 3: must be an object with "points", or with one of saturation, dead_zone, '),
        ({"points": [[0, 0], [0, 0]]}, "curves[0].points[1] = (0.0, 0.0): must be another"),
        ({"points": [[0, 0], [1]]}, "curves[0].points[1] = [1]: must be a pair [y, u]"),
        ({"points": [["a", 0]]}, "curves[0].points[0][0] = 'a': must be a number"),
        ({"points": []}, "curves[0].points = []: must be a list of pairs [y, u]"),
        ({"points": [[0, 0]], "left_slope": "steep"}, "curves[0].left_slope = 'steep': must be a number"),
        ({"points": [[0, 0]], "limit": 1}, "curves[0] has no key 'limit': choose from points"),
        ({"saturation": {"limit": -1}}, "curves[0].saturation.limit = -1.0: must be a finite number > 0"),
        ({"saturation": {"height": 1}}, "curves[0].saturation has no key 'height': choose from gain"),
        ({"saturation": {}, "relay_step": {}}, "curves[0] has no key 'relay_step': choose from saturation"),
        (
            {"resistor": {"voltages": [0]}},
            "curves[0].resistor.currents is missing: one for each corner",
        ),
        ({"saturation": {"limit": [1, 2]}}, "curves[0].saturation.limit = [1, 2]: must be a number"),
        ({"saturation": 1}, "curves[0].saturation = 1: must be an object with the keys gain, limit"),
        ({"hysteresis": {}}, "curves[0] = {'hysteresis': {}}: must be an object with "),
        ({}, "curves[0] = {}: must be an object with "),
    ],
)
def test_what_is_wrong_is_named(entry: Any, message: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        read(entry)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("value", WRONG)
@pytest.mark.parametrize(
    ("field", "entry"),
    [
        ("", lambda value: value),
        (".points", lambda value: {"points": value}),
        (".left_slope", lambda value: {"points": [[0, 0]], "left_slope": value}),
        (".saturation.limit", lambda value: {"saturation": {"limit": value}}),
    ],
)
def test_a_value_of_the_wrong_kind_is_refused_by_its_key(field: str, entry: Any, value: Any) -> None:
    with pytest.raises(InvalidInputError) as caught:
        read(entry(value))
    assert caught.value.field.startswith(f"curves[0]{field}")
