import math

import numpy as np
import pytest

from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION
from pricing_core.american.engines.method_of_lines.event_transfer import (
    Dropped,
    GridFunction,
    Kink,
    Payoff,
    SlopeWeights,
    before_event,
)

NODES = np.exp(np.linspace(-1.0, 1.0, 81))


def segment(**changes):
    fields = {
        "exercisable": True,
        "exercise_at_end": True,
        "fraction": 0.0,
        "due": 0.0,
        "amount": 0.0,
        "escrow": 0.0,
    }
    return Segment(0.0, 1.0, 0.05, 0.0, 0.2, **(fields | changes))


def grid_function(values, nodes=NODES, at_zero=0.0):
    return GridFunction.through(nodes, values, at_zero, SlopeWeights.of(nodes))


def test_slopes_are_exact_for_quartics():
    slopes = SlopeWeights.of(NODES).slopes(NODES**4 - 3.0 * NODES**2 + NODES)
    assert slopes == pytest.approx(4.0 * NODES**3 - 6.0 * NODES + 1.0, abs=1e-9)


def test_straight_lines_are_met_to_rounding_everywhere():
    line = grid_function(1.0 - NODES, at_zero=1.0)
    s = np.linspace(0.0, 5.0, 1001)
    assert line.value(s) == pytest.approx(1.0 - s, abs=1e-14)
    assert line.slope(s) == pytest.approx(np.full(s.size, -1.0), abs=1e-11)


def test_interpolation_is_of_fourth_order():
    errors = []
    s = np.linspace(0.5, 2.0, 1000)
    for cells in (40, 80, 160):
        nodes = np.exp(np.linspace(-1.0, 1.0, cells + 1))
        errors.append(np.max(np.abs(grid_function(np.exp(-nodes), nodes).value(s) - np.exp(-s))))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(4.0, abs=0.4)


def test_monotone_values_stay_monotone_between_the_nodes():
    rng = np.random.default_rng(3)
    values = np.cumsum(rng.choice([0.0, 0.0, 1e-3, 1.0], NODES.size))
    s = np.linspace(NODES[0], NODES[-1], 5000)
    found = grid_function(values).value(s)
    assert np.all(np.diff(found) >= -1e-13)
    slopes = grid_function(values).slope(s[1:-1])
    differences = (found[2:] - found[:-2]) / (s[2] - s[0])
    inside = np.abs(slopes - differences) < 0.5 + 0.02 * np.abs(slopes)
    assert inside.mean() > 0.95


@pytest.mark.parametrize("place", np.linspace(1.0, 1.025, 6))
def test_a_kink_counts_the_same_wherever_it_lies_between_two_nodes(place):
    """sum v_i G_i h = integral + h**2 jump G/12, whatever the place, where v has been projected."""

    def weight(s):
        return np.exp(-30.0 * (s - 1.1) ** 2)

    h = 0.025
    nodes = np.arange(0.1, 2.5, h)
    shift = segment(amount=place - 1.0, exercise_at_end=False)
    values = before_event(Payoff(1.0), 1.0, shift, 1.0, 1.0, nodes).values
    fine = np.linspace(nodes[0], nodes[-1], 400_001)
    payoff = 1.0 - np.clip(fine - shift.amount, 0.0, 1.0)
    exact = np.trapezoid(payoff * weight(fine), fine)
    assert h * np.sum(values * weight(nodes)) - exact == pytest.approx(h**2 / 12.0 * weight(place), rel=0.03)


def test_a_dividend_shifts_the_kinks_and_makes_one_where_the_spot_is_gone():
    dropped = Dropped(Payoff(1.0), 0.1, 0.2)
    assert dropped.kinks == (Kink(1.2 / 0.9, 0.9), Kink(0.2 / 0.9, -0.9))
    s = np.array([0.1, 0.2, 1.0, 2.0])
    assert dropped.value(s) == pytest.approx([1.0, 1.0, 0.3, 0.0])
    assert dropped.slope(s) == pytest.approx([0.0, 0.0, -0.9, 0.0])
    assert Dropped(Payoff(1.0), 1.0, 0.2).kinks == ()


def test_a_call_is_exercised_above_a_root_before_a_dividend():
    nodes = np.linspace(0.2, 3.0, 400)
    after = grid_function(0.6 * nodes, nodes)
    event = before_event(after, 0.0, segment(amount=0.25), -1.0, 1.0, nodes)
    assert event.region.lower == pytest.approx(2.125, rel=1e-12)  # s - 1 = 0.6 (s - 0.25)
    assert event.region.upper == math.inf
    assert event.values[-1] == nodes[-1] - 1.0
    assert np.all(event.values >= nodes - 1.0)


def test_nobody_exercises_a_put_just_before_a_dividend():
    after = grid_function(np.maximum(1.0 - NODES, 0.3 * np.exp(-NODES)), at_zero=1.0)
    event = before_event(after, 1.0, segment(amount=0.05), 1.0, 1.0, NODES)
    assert event.region == EMPTY_REGION
    assert event.at_zero == 1.0


def test_the_escrow_counts_in_what_exercise_brings():
    after = grid_function(np.full(NODES.size, 0.1), at_zero=0.1)
    event = before_event(after, 0.1, segment(escrow=20.0), 1.0, 100.0, NODES)
    assert event.region.upper == pytest.approx(0.7, rel=1e-12)  # 1 - 0.2 - s = 0.1
    assert event.region.lower == -math.inf
    assert event.at_zero == pytest.approx(0.8)
