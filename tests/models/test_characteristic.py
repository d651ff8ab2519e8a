import math

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.models import (
    Characteristic,
    coulomb_friction,
    dead_zone,
    gain_schedule,
    relay_step,
    resistor,
    saturation,
)


@pytest.mark.parametrize(
    ("curve", "formula"),
    [
        (saturation(2.0, 3.0), lambda y: np.clip(2 * y, -3, 3)),
        (dead_zone(0.5, 2.0), lambda y: 2 * np.sign(y) * np.maximum(np.abs(y) - 0.5, 0)),
        (
            gain_schedule([-1.0, 2.0], [3.0, 1.0, 0.5]),
            lambda y: np.where(y < -1, 3 * y + 2, np.minimum(y, 0.5 * y + 1)),
        ),
        (gain_schedule([1.0], [1.0, 2.0], [0.0, -1.0]), lambda y: np.maximum(y, 2 * y - 1)),
        (gain_schedule([1.0, 2.0], [1.0, 2.0, 0.0]), lambda y: np.minimum(np.maximum(y, 2 * y - 1), 3.0)),
        (resistor([0.0, 1.0], [0.0, 2.0], 0.0, 1.0), lambda y: np.where(y < 0, 0, np.minimum(2 * y, y + 1))),
    ],
)
def test_named_characteristics_are_the_functions_that_they_are_called(curve, formula):
    y = np.linspace(-4.0, 4.0, 81)
    assert curve(y) == pytest.approx(formula(y), abs=1e-12)
    assert curve.distance(y, curve(y)) == pytest.approx(np.zeros(81), abs=1e-12)


def test_vertical_parts_have_no_value_but_a_distance():
    curve = coulomb_friction(2.0, 0.5)
    assert not curve.is_function
    with pytest.raises(InvalidInputError, match="piece 1 with y not increasing"):
        curve(0.0)
    assert curve.distance([0.0, 1.0, 1.0], [1.5, -2.5, 1.0]).tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Characteristic(np.zeros((0, 2))), "points"),
        (lambda: Characteristic([(0, 1, 2)]), "points.*pair"),
        (lambda: Characteristic([(0, 0), (1, 1), (1, 1)]), r"points\[2\].*another"),
        (lambda: Characteristic([(0, 0), (0, 2), (0, 1)]), r"points\[1\].*back on itself"),
        (lambda: Characteristic([(0, 0), (0, -1)], left_slope=math.inf), r"points\[0\].*back on itself"),
        (lambda: Characteristic([(0, 0)], math.nan), "left_slope"),
        (lambda: Characteristic([(0, 0)], right_slope="steep"), "right_slope"),
        (lambda: relay_step(1.0, 1.0), "lower = 1.0"),
        (lambda: saturation(limit=0.0), "limit"),
        (lambda: coulomb_friction(1.0, -1.0), "viscosity"),
        (
            lambda: resistor([0, 2, 1], [0, 1, 2], 1, 1),
            r"voltages\[2\] = 1.0: must be at least voltages\[1\] = 2",
        ),
        (lambda: gain_schedule([1, 0], [1, 2, 3]), "thresholds"),
        (
            lambda: gain_schedule([1.0], [1.0, 2.0], [0.0, 0.0]),
            r"offsets\[1\].*meet at thresholds\[0\] = 1.*1 and 2",
        ),
    ],
)
def test_what_is_no_connected_polyline_is_refused_by_its_element(make, message):
    with pytest.raises(InvalidInputError, match=message):
        make()
