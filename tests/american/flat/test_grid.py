import math

import numpy as np
import pytest

from pricing_core.american import Market, Option, Resolution, price
from pricing_core.american.flat.closed_form import perpetual_boundary
from pricing_core.american.flat.grid import Domain, exercise_domain, make_grid
from pricing_core.american.flat.resolution import align
from pricing_core.american.flat.time_mesh import square_root_mesh, uniform_mesh
from pricing_core.errors import InvalidInputError

DOMAIN = Domain(-0.8, 1.5, True, False, 1e-8)


def test_stretched_grids_are_finest_at_the_strike():
    widths = np.diff(make_grid(DOMAIN, 60, 3.0).nodes)
    assert np.argmin(widths) == pytest.approx(np.searchsorted(make_grid(DOMAIN, 60, 3.0).nodes, 0.0), abs=1)
    assert widths.max() > 5 * widths.min()


@pytest.mark.parametrize("stretching", [0.0, 2.0])
def test_doubling_the_intervals_keeps_every_node(stretching):
    coarse, fine = (make_grid(DOMAIN, n, stretching).nodes for n in (20, 40))
    assert fine[::2] == pytest.approx(coarse, abs=1e-12)


def test_alignment_puts_the_strike_on_a_node():
    aligned = align(DOMAIN, 48, 0.0)
    assert np.min(np.abs(make_grid(aligned, 48).nodes)) < 1e-14
    assert aligned.left <= DOMAIN.left
    assert aligned.right >= DOMAIN.right
    assert aligned.right - aligned.left < (DOMAIN.right - DOMAIN.left) * (1 + 3 / 48)


def test_the_domain_reaches_just_below_the_perpetual_boundary_for_long_expiries():
    market = Market(100.0, 0.06, 0.2)
    domain = exercise_domain(Option("put", 100.0, 150.0), market, 1e-8)
    lowest = math.log(perpetual_boundary(market, "put"))
    assert lowest - 1.0 < domain.left < lowest
    assert domain.contact_at_left


def test_call_and_put_domains_mirror_each_other():
    put = exercise_domain(Option("put", 100.0, 1.0), Market(100.0, 0.06, 0.2, 0.02), 1e-8)
    call = exercise_domain(Option("call", 100.0, 1.0), Market(100.0, 0.02, 0.2, 0.06), 1e-8)
    assert (call.left, call.right) == (-put.right, -put.left)
    assert (call.contact_at_left, call.contact_at_right) == (False, True)


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_a_wider_domain_does_not_change_the_price(option_type):
    """The domain is cut where the premium is below a hundredth of the tolerance."""
    option, market = Option(option_type, 100.0, 1.0), Market(100.0, 0.04, 0.3, 0.05)
    loose, tight = (price(option, market, tolerance=t, resolution=Resolution(800, 100)) for t in (1e-4, 1e-8))
    assert loose.price == pytest.approx(tight.price, abs=2e-4)


def test_extreme_contracts_stay_within_the_range_of_floating_point_numbers():
    domain = exercise_domain(Option("put", 100.0, 200.0), Market(100.0, 0.01, 15.0), 1e-8)
    assert -100.0 <= domain.left < domain.right <= 100.0
    assert domain.neglected > 1e-8


def test_time_meshes():
    assert square_root_mesh(2.0, 4) == pytest.approx([0.0, 0.125, 0.5, 1.125, 2.0])
    assert uniform_mesh(2.0, 4) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])


@pytest.mark.parametrize(
    ("field", "bad"),
    [
        ("intervals", 3),
        ("intervals", 10.0),
        ("intervals", 10**6),
        ("steps", 1),
        ("time_mesh", "random"),
        ("scheme", "euler"),
        ("formulation", "log"),
    ],
)
def test_bad_resolutions_are_refused(field, bad):
    with pytest.raises(InvalidInputError, match=field):
        Resolution(**{field: bad})
