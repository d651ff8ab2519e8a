"""The averaged complementarity function: what it averages, its shape, and what it becomes without averaging."""

import numpy as np
import pytest

from pricing_core.obstacle.averaged import Contact


def contact(n, *, c=0.05, diffusion=3.0, lower=0.0, upper=np.inf, upper_mass=0.0, right_angle=False):
    full = np.full
    return Contact(
        full(n, lower),
        full(n, upper),
        full(n, c),
        full(n, upper_mass),
        full(n, diffusion),
        full(n, right_angle),
    )


def test_the_mass_is_that_of_the_multiplier_under_the_hat_next_to_a_contact_set():
    """u = c on one side of a place, 0 on the other; V leaves the obstacle there as a parabola with D V'' = c."""
    c, D = 0.05, 3.0
    side = contact(1, c=c, diffusion=D).side(np.ones(1), np.ones(1))
    xi = np.linspace(-1.0, 1.0, 200_001)
    hat = 1.0 - np.abs(xi)
    for distance in (0.0, 0.1, 0.3, 0.7, 0.99, 1.0):  # of the contact set's end, to the left of the node
        u = np.where(xi <= -distance, c, 0.0)
        value = c * distance**2 / (2.0 * D)
        s = side.parameter(np.array([value]), np.array([c / 2.0]))
        point = side.at(s)
        assert point.value[0] == pytest.approx(value, abs=1e-16)
        assert point.mass[0] == pytest.approx(np.trapezoid(u * hat, xi), abs=6e-7)


def test_value_rises_and_mass_falls_and_both_are_smooth():
    s = np.linspace(-3.0, 4.0, 7001)
    side = contact(s.size).side(np.ones(s.size), np.ones(s.size))
    point = side.at(s)
    assert (np.diff(point.value) >= 0.0).all()
    assert (np.diff(point.mass) <= 0.0).all()
    step = s[1] - s[0]
    assert np.allclose(np.gradient(point.value, step), point.slope, rtol=0.0, atol=2e-5)
    assert np.allclose(np.gradient(point.mass, step), point.change, rtol=0.0, atol=1e-4)
    assert point.mass[s >= 1.0].max() == 0.0
    assert (point.value[s <= 0.0] == 0.0).all()
    assert (point.mass[s <= 0.0] >= 0.025).all()


def test_the_parameter_of_a_point_of_the_curve_is_its_own():
    s = np.array([-2.0, -0.5, 0.2, 0.9, 1.0, 1.5, 40.0])
    for sign in (1.0, -1.0):
        given = contact(
            s.size,
            c=0.05 if sign > 0 else 0.0,
            upper_mass=0.0 if sign > 0 else 0.05,
            lower=0.0 if sign > 0 else -np.inf,
            upper=np.inf if sign > 0 else 1.0,
        )
        side = given.side(np.full(s.size, 0.5), np.ones(s.size))
        point = side.at(s)
        assert np.allclose(side.parameter(point.value, point.mass), s, rtol=1e-12, atol=1e-12)


def test_where_nothing_can_be_in_contact_the_parameter_is_the_value():
    s = np.array([-3.0, 0.2, 7.0])
    side = contact(3, c=0.0).side(s, np.ones(3))
    point = side.at(s)
    assert np.allclose(point.value, s, rtol=1e-15, atol=1e-15)
    assert (point.mass == 0.0).all()
    assert (point.slope == 1.0).all()


def test_the_right_angle_pins_between_both_obstacles():
    s = np.array([-1.0, 0.3, 2.0])
    side = contact(3, upper=1.0, right_angle=True).side(s, np.full(3, 4.0))
    point = side.at(s)
    assert point.value.tolist() == [0.0, 0.3, 1.0]
    assert point.mass.tolist() == [4.0, 0.0, -4.0]
    assert np.array_equal(side.parameter(point.value, point.mass), s)
