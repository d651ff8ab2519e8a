import math

import numpy as np
import pytest

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION, ExerciseRegion
from pricing_core.american.engines.method_of_lines.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.engines.method_of_lines.grid import Grid
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.stage import OptionState, TridiagonalStage, start_state
from pricing_core.american.engines.perpetual import perpetual_boundary

RATE, VOLATILITY = 0.08, 0.3
LONG = 1e5  # years
BOUNDARY = perpetual_boundary(is_put=True, rate=RATE, dividend_yield=0.0, volatility=VOLATILITY)
POWER = BOUNDARY / (1.0 - BOUNDARY)


def perpetual_put(s):
    """(1 - S*) (s/S*)**-power where held."""
    return np.where(s > BOUNDARY, (1.0 - BOUNDARY) * (np.maximum(s, BOUNDARY) / BOUNDARY) ** -POWER, 1.0 - s)


def form_on(nodes):
    segment = Segment(0.0, 1.0, RATE, 0.0, VOLATILITY, True, True, 0.0, 0.0, 0.0, 0.0)
    values = perpetual_put(nodes)
    return SegmentForm.discretise(segment, Grid(nodes), sign=1.0, strike=1.0, values=values, watched=(1.0,))


def stationary(stage, form):
    """One stage so long that it leaves nothing of what it starts from; the ends keep their exact values."""
    start = start_state(form, perpetual_put(form.grid.nodes))
    return stage.solve(1e-12, 0.0 * start.value, LONG, start)


@pytest.mark.parametrize("place", np.linspace(0.05, 0.95, 7))
def test_the_error_does_not_depend_on_the_place_of_the_boundary_in_its_cell(place):
    """The perpetual put, whose boundary stands still, at the strike: uncorrected it is -9e-5 to 1e-5."""
    h = 0.02
    form = form_on(BOUNDARY + h * (np.arange(-20, 150) + place))
    plain = TridiagonalStage(form)
    state = stationary(BoundaryCellStage(plain), form)
    error = np.interp(1.0, form.grid.interior, state.value - perpetual_put(form.grid.interior))
    assert error == pytest.approx(1.3e-5, abs=4e-6)
    assert state.residual < 1e-12 * LONG / h**2
    assert region_in_cells(state, form).upper == pytest.approx(BOUNDARY, abs=0.02 * h)
    uncorrected = stationary(plain, form)
    assert np.all(state.contact <= uncorrected.contact)  # it frees a node no later


def test_a_state_without_exercise_is_left_alone():
    form = form_on(np.linspace(0.9, 2.0, 60))
    stage = TridiagonalStage(form)
    start = start_state(form, perpetual_put(form.grid.nodes) + 0.2)
    plain = stage.solve(0.01, start.value, 0.01, start)
    corrected = BoundaryCellStage(stage).solve(0.01, start.value, 0.01, start)
    assert not plain.contact.any()
    assert np.array_equal(plain.value, corrected.value)
    assert region_in_cells(corrected, form) == EMPTY_REGION


# The place of the boundary between two nodes, from a slack that is a parabola.

NODES = np.linspace(0.5, 1.5, 51)
BOTH = {"put": (1.0, -0.02, -0.06), "call": (-1.0, -0.06, -0.02)}  # sign, rate and yield: two boundaries


def plain_form(sign, rate, dividend_yield, *, exercisable=True):
    segment = Segment(
        0.0, 1.0, rate, dividend_yield, VOLATILITY, exercisable, exercisable, 0.0, 0.0, 0.0, 0.0
    )
    values = np.maximum(sign * (1.0 - NODES), 0.0)
    return SegmentForm.discretise(segment, Grid(NODES), sign=sign, strike=1.0, values=values, watched=(1.0,))


def parabola(form, boundary, free_side):
    """Return J (s - s_f)**2/2 on the free side, J that of the contact node next to the boundary."""
    s = NODES[1:-1]
    distance = free_side * (s - boundary)
    contact = int(np.flatnonzero(distance <= 0.0)[-1 if free_side > 0 else 0])
    return np.where(distance > 0.0, 0.5 * form.curvature(contact) * distance**2, 0.0)


def state_of(slack):
    return OptionState(slack, slack, slack == 0.0, np.zeros(slack.size), 0.0)


@pytest.mark.parametrize("boundary", [0.8, 0.801, 0.8101, 0.8199])
def test_a_boundary_between_nodes_is_the_vertex(boundary):
    form = plain_form(1.0, 0.08, 0.0)
    found = region_in_cells(state_of(parabola(form, boundary, 1)), form)
    assert found.lower == -math.inf
    assert found.upper == pytest.approx(boundary, abs=1e-9)


@pytest.mark.parametrize("boundary", [1.2, 1.2101, 1.2199])
def test_the_boundary_of_a_call_is_found_from_the_other_side(boundary):
    form = plain_form(-1.0, 0.02, 0.08)
    found = region_in_cells(state_of(parabola(form, boundary, -1)), form)
    assert found.upper == math.inf
    assert found.lower == pytest.approx(boundary, abs=1e-9)


@pytest.mark.parametrize("option_type", BOTH)
def test_two_boundaries_and_none(option_type):
    form = plain_form(*BOTH[option_type])
    middle = 0.5 * (NODES[0] + NODES[-1])
    both = np.where(NODES[1:-1] < middle, parabola(form, 0.822, -1), parabola(form, 1.133, 1))
    found = region_in_cells(state_of(both), form)
    assert (found.lower, found.upper) == (pytest.approx(0.822, abs=1e-9), pytest.approx(1.133, abs=1e-9))
    assert region_in_cells(state_of(np.ones(NODES.size - 2)), form) == EMPTY_REGION


def test_what_cannot_be_exercised_has_no_region_and_what_is_exercised_everywhere_no_end():
    everywhere = state_of(np.zeros(NODES.size - 2))
    assert region_in_cells(everywhere, plain_form(1.0, 0.08, 0.0, exercisable=False)) == EMPTY_REGION
    assert region_in_cells(everywhere, plain_form(1.0, 0.08, 0.0)) == ExerciseRegion(-math.inf, math.inf)
