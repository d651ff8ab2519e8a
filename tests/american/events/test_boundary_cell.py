import numpy as np
import pytest

from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.events.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.events.scheduled_form import SegmentForm
from pricing_core.american.flat.closed_form import perpetual_boundary
from pricing_core.american.flat.exercise_region import EMPTY_REGION
from pricing_core.american.flat.grid import Grid
from pricing_core.american.flat.tridiagonal_step import TridiagonalStage

RATE, VOLATILITY = 0.08, 0.3
LONG = 1e5  # years
BOUNDARY = perpetual_boundary(FlatMarket(100.0, RATE, VOLATILITY, 0.0), "put")
POWER = BOUNDARY / (1.0 - BOUNDARY)


def perpetual_put(s):
    """(1 - S*) (s/S*)**-power where held."""
    return np.where(s > BOUNDARY, (1.0 - BOUNDARY) * (np.maximum(s, BOUNDARY) / BOUNDARY) ** -POWER, 1.0 - s)


def form_on(nodes):
    segment = Segment(0.0, 1.0, RATE, 0.0, VOLATILITY, True, True, 0.0, 0.0, 0.0)
    return SegmentForm.discretise(segment, Grid(nodes), 1.0, 1.0, perpetual_put(nodes), (1.0,))


def stationary(stage, form):
    """One stage so long that it leaves nothing of what it starts from; the ends keep their exact values."""
    start = form.start(perpetual_put(form.grid.nodes))
    return stage.solve(1e-12, 0.0 * start.value, LONG, start)


@pytest.mark.parametrize("place", np.linspace(0.05, 0.95, 7))
def test_the_error_does_not_depend_on_the_place_of_the_boundary_in_its_cell(place):
    """The perpetual put, whose boundary stands still, at the strike: uncorrected it is -9e-5 to 1e-5."""
    h = 0.02
    form = form_on(BOUNDARY + h * (np.arange(-20, 150) + place))
    plain = TridiagonalStage(form)
    state = stationary(BoundaryCellStage(plain, form), form)
    error = np.interp(1.0, form.grid.interior, state.value[0] - perpetual_put(form.grid.interior))
    assert error == pytest.approx(1.3e-5, abs=4e-6)
    assert state.residual < 1e-12 * LONG / h**2
    assert region_in_cells(state, form).upper == pytest.approx(BOUNDARY, abs=0.02 * h)
    uncorrected = stationary(plain, form)
    assert np.all(state.contact <= uncorrected.contact)  # it frees a node no later


def test_a_state_without_exercise_is_left_alone():
    form = form_on(np.linspace(0.9, 2.0, 60))
    stage = TridiagonalStage(form)
    start = form.start(perpetual_put(form.grid.nodes) + 0.2)
    plain = stage.solve(0.01, start.value, 0.01, start)
    corrected = BoundaryCellStage(stage, form).solve(0.01, start.value, 0.01, start)
    assert not plain.contact.any()
    assert np.array_equal(plain.value, corrected.value)
    assert region_in_cells(corrected, form) == EMPTY_REGION
