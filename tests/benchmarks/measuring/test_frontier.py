import math

import pytest

from benchmarks.measuring.frontier import Point, lower_envelope, time_at

CURVE = [Point(1e-2, 1.0), Point(1e-4, 10.0), Point(1e-6, 1000.0)]


def test_the_envelope_leaves_out_what_another_point_beats_in_error_and_time():
    beaten = [Point(1e-3, 20.0), Point(2e-2, 1.0), Point(1e-2, 2.0)]
    assert lower_envelope([*beaten, *CURVE]) == tuple(CURVE)


def test_the_envelope_leaves_out_points_without_an_error():
    assert lower_envelope([Point(math.nan, 0.1), Point(math.inf, 0.1), Point(0.0, 0.1), *CURVE]) == tuple(
        CURVE
    )


def test_a_gain_thins_the_envelope():
    assert lower_envelope([Point(1.0, 1.0), Point(0.95, 2.0), Point(0.8, 3.0)], gain=0.1) == (
        Point(1.0, 1.0),
        Point(0.8, 3.0),
    )


@pytest.mark.parametrize(
    ("error", "microseconds"),
    [(1e-4, 10.0), (1e-3, math.sqrt(10.0)), (1e-5, 100.0), (1e-6, 1000.0), (0.5, 1.0)],
)
def test_between_points_the_time_is_a_power_of_the_error(error, microseconds):
    assert time_at(reversed(CURVE), error) == pytest.approx(microseconds, rel=1e-12)


def test_an_error_that_no_point_reaches_has_no_time():
    assert time_at(CURVE, 9e-7) is None
    assert time_at([], 1e-3) is None
