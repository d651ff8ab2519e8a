import math

import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.models.characteristic_file import characteristic_from_json


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
def test_characteristics_have_points_or_a_name(entry, points, slopes):
    curve = characteristic_from_json("curve", entry)
    assert curve.points.tolist() == points
    assert (curve.left_slope, curve.right_slope) == slopes


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (3, r"curve = 3"),
        ({"points": [[0, 0], [0, 0]]}, r"curve.points\[1\]"),
        ({"points": [[0, 0], [1]]}, r"curve.points = .*rows of one length"),
        ({"points": [["a", 0]]}, r"curve.points = .*real numbers"),
        ({"points": [[0, 0]], "left_slope": "steep"}, r"curve.left_slope = 'steep'"),
        ({"saturation": {"limit": -1}}, r"curve.limit = -1"),
        (
            {"saturation": {"height": 1}},
            r"curve.saturation.height = 1: must be left out; known are gain, limit",
        ),
        ({"resistor": {"voltages": [0]}}, r"curve.resistor.currents = missing"),
        ({"saturation": {"limit": [1, 2]}}, r"curve.saturation.limit = \[1, 2\]: must be one number"),
        ({"saturation": 1}, r"curve.saturation = 1: must be an object with the arguments gain, limit"),
        ({"hysteresis": {}}, r"curve.points = missing: must be given, or one of saturation"),
    ],
)
def test_what_is_wrong_is_named(entry, message):
    with pytest.raises(InvalidInputError, match=message):
        characteristic_from_json("curve", entry)
