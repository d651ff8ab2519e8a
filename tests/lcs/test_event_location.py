import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from pricing_core.lcs.event_location import first_crossing, touching_places
from pricing_core.lcs.mode_dynamics import DEGREE

CLOSE = np.array([1e-11])


def column(*coefficients):
    padded = np.zeros((DEGREE + 1, 1))
    padded[: len(coefficients), 0] = coefficients
    return padded


@given(st.lists(st.floats(0.05, 1.5), min_size=1, max_size=5, unique=True))
@settings(max_examples=200, deadline=None)
def test_the_first_of_several_zeros_is_found(roots):
    roots = np.sort(roots)
    if np.any(np.diff(roots) < 0.02):
        return
    coefficients = polynomial.polyfromroots(roots)
    if roots.size % 2:
        coefficients = -coefficients  # positive before the first
    crossing = first_crossing(column(*coefficients), 1.0, CLOSE)
    if roots[0] < 0.999:
        assert crossing.place == pytest.approx(roots[0], abs=1e-9)
    elif roots[0] > 1.0:
        assert crossing is None


@pytest.mark.parametrize("depth", [1e-10, 1e-7, 1e-3])
def test_a_short_dip_is_seen(depth):
    dip = column(0.25 - depth, -1.0, 1.0)  # (s - 1/2)**2 - depth
    assert first_crossing(dip, 1.0, CLOSE).place == pytest.approx(0.5 - np.sqrt(depth), rel=1e-6)


def test_a_touch_is_no_crossing_and_its_place_is_told():
    touch = column(0.25, -1.0, 1.0)
    assert first_crossing(touch, 1.0, CLOSE) is None
    assert touching_places(touch, 1.0, CLOSE) == pytest.approx([0.5])
    assert touching_places(touch, 0.4, CLOSE) == []


def test_a_start_on_zero_is_a_crossing_only_where_it_falls():
    assert first_crossing(column(0.0, 1.0), 1.0, CLOSE) is None
    assert first_crossing(column(-1e-17, 0.0, 1.0), 1.0, CLOSE) is None
    assert first_crossing(column(0.0, -1.0), 1.0, CLOSE).place == 0.0
    assert first_crossing(column(-1e-17, 1.0, -2.0), 1.0, CLOSE).place == pytest.approx(0.5)


def test_a_bounce_below_the_tolerance_ends_where_it_comes_down():
    """From -1e-16 it rises to 2.5e-15, comes down at 1e-7, and falls below minus its tolerance much later."""
    crossing = first_crossing(column(-1e-16, 1e-7, -1.0), 1.0, CLOSE)
    assert crossing is not None
    assert crossing.place == pytest.approx(1e-7, rel=1e-1)


def test_outputs_that_cross_together_are_told_together():
    both = np.hstack([column(0.5, -1.0), column(1.0, -2.0), column(1.0)])
    assert first_crossing(both, 1.0, np.full(3, 1e-11)).outputs == (0, 1)


def test_what_happens_behind_the_end_is_not_seen():
    assert first_crossing(column(0.5, -1.0), 0.49, CLOSE) is None
