"""Signs of polynomials that are proved in interval arithmetic."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import BSpline

from pricing_core.chains.surface.bernstein import derivative, elevated, positive, product, spline_pieces
from pricing_core.chains.surface.interval import Interval


def at(coefficients, t):
    """Return the values of polynomials on [0, 1] by de Casteljau."""
    row = [coefficients[:, i] for i in range(coefficients.shape[1])]
    while len(row) > 1:
        row = [(1 - t) * one + t * two for one, two in pairwise(row)]
    return row[0]


@pytest.mark.parametrize("seed", range(5))
def test_products_and_elevations_have_the_values_of_the_polynomials(seed):
    generator = np.random.default_rng(seed)
    a, b = generator.standard_normal((4, 4)), generator.standard_normal((4, 6))
    both = product(Interval.exactly(a), Interval.exactly(b))
    higher = elevated(Interval.exactly(a), 9)
    for t in (0.0, 0.3, 1.0):
        assert at(both.low, t) == pytest.approx(at(a, t) * at(b, t), abs=1e-12)
        assert at(higher.high, t) == pytest.approx(at(a, t), abs=1e-12)
        assert np.all(at(both.low, t) <= at(both.high, t))


@pytest.mark.parametrize("seed", range(5))
def test_the_pieces_of_a_spline_enclose_it_and_its_derivative(seed):
    generator = np.random.default_rng(seed)
    breaks = np.cumsum(0.1 + generator.random(8))
    knots = np.concatenate([np.full(5, breaks[0]), breaks, np.full(5, breaks[-1])])
    coefficients = generator.standard_normal((2, breaks.size + 4))
    rows, spans = np.repeat([0, 1], 7), np.tile(np.arange(7), 2)
    ends = Interval.exactly(breaks[spans]), Interval.exactly(breaks[spans + 1])
    pieces = spline_pieces(knots, coefficients, 5, (rows, spans + 5), ends)
    slopes = derivative(pieces, ends[1] - ends[0])
    for t in (0.0, 0.4, 0.9):
        x = breaks[spans] + t * (breaks[spans + 1] - breaks[spans])
        for found, order in ((pieces, 0), (slopes, 1)):
            curves = [BSpline(knots, own, 5).derivative(order)(x) for own in coefficients]
            expected = np.where(rows == 0, *curves)
            assert 0.5 * (at(found.low, t) + at(found.high, t)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_square_plus_a_little_is_proved_and_less_a_little_is_not(seed):
    generator = np.random.default_rng(seed)
    a = generator.standard_normal((1, 6))
    root = generator.random()
    a = a - at(a, root)[0]
    square = product(Interval.exactly(a), Interval.exactly(a))
    for shift, expected in ((1e-6, True), (-1e-6, False)):
        holds, places = positive(square + Interval.exactly(shift))
        assert holds is expected
        assert expected == (places.size == 0)
        for place in places[places < 1.0]:
            assert at(a, place)[0] ** 2 < 1.1e-6
