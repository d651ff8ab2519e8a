"""Values of the wrong kind are refused by the name of their argument, wherever a model takes it."""

from fractions import Fraction

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import TimeStepping
from pricing_core.models import (
    Characteristic,
    ControlAffineProblem,
    DiodeCircuit,
    MechanicalSystem,
    PiecewiseLinearSystem,
    ProjectedSystem,
    RelaySystem,
    box_stack,
    coulomb_friction,
    dead_zone,
    friction_directions,
    gain_schedule,
    relay_step,
    resistor,
    saturation,
)
from tests.problems.bad_values import WRONG, by_name

ONE = np.eye(2)
BOX = ProjectedSystem((ONE, [1, 2]), ONE, [0, 0])
DISC = ProjectedSystem(lambda x: x, constraints=lambda x: [1 - x @ x])
RELAY = RelaySystem([[0]], [[1]], [[1]])
RUN = RELAY.simulate([1.0], (0.0, 0.5))
CONTROL = {
    "reward": lambda t, x, u: -0.5 * (x @ x + u @ u),
    "drift": lambda t, x: [0.0],
    "input_map": lambda t, x: [[1.0]],
    "x0": [1.0],
    "horizon": 1.0,
}


def relay(**given):
    return RelaySystem(**{"A": [[0]], "B": [[1]], "C": [[1]], **given})


def polylines(**given):
    return PiecewiseLinearSystem(
        **{"A": [[0]], "B": [[1]], "C": [[1]], "D": None, "characteristics": [saturation()], **given}
    )


def ball(**given):
    return MechanicalSystem(**{"mass": [[1]], "damping": [[0]], "stiffness": [[0]], "F": [[1]], **given})


def rough_ball(**given):
    return ball(**{"tangents": [[1]], "friction": [0.5], **given})


def boxes(**given):
    return box_stack(**{"mass": [1], "width": [1], "height": [1], "friction": [1], **given})


def directions(**given):
    return friction_directions(**{"first": [1, 0], "second": [0, 1], "m": 4, **given})


def thrown(**given):
    return ball().simulate(**{"q0": [1.0], "v0": [0.0], "t_span": (0, 1), **given})


def in_the_box(**given):
    return BOX.simulate(**{"x0": [1, 1], "t_span": (0, 1), "method": TimeStepping(tolerance=0.5), **given})


def in_the_disc(**given):
    return DISC.simulate(**{"x0": [0, 0], "t_span": (0, 1), **given})


def relayed(**given):
    return RELAY.simulate(**{"x0": [1.0], "t_span": (0, 1), **given})


TAKEN = [
    *by_name(relay, "A", "B", "C", "D", "lower", "upper"),
    *by_name(relayed, "x0", "t_span", "method", "t_eval", "form"),
    ("count", RUN.refined),
    ("t", RUN),
    *by_name(polylines, "A", "B", "C", "D", "characteristics"),
    ("method", lambda value: polylines().simulate([1.0], (0, 1), method=value)),
    ("method", lambda value: DiodeCircuit().resistor("R", "a", "0", 1).simulate((0, 1), method=value)),
    *by_name(ball, "mass", "damping", "stiffness", "F", "force", "offset", "restitution"),
    *by_name(rough_ball, "tangents", "friction"),
    *by_name(boxes, "mass", "width", "height", "friction", "slope", "gravity", "restitution"),
    *by_name(directions, "first", "second", "m"),
    *by_name(thrown, "q0", "v0", "t_span", "method", "t_eval"),
    ("q", lambda value: ball().energy(value, [1.0])),
    ("v", lambda value: ball().energy([1.0], value)),
    *by_name(in_the_box, "x0", "t_span", "method", "t_eval"),
    *by_name(in_the_disc, "x0", "t_span", "method", "t_eval"),
    ("F", lambda value: ProjectedSystem(value, ONE, [0, 0])),
    ("H", lambda value: ProjectedSystem((ONE, [1, 2]), value, [0, 0])),
    ("h", lambda value: ProjectedSystem((ONE, [1, 2]), ONE, value)),
    ("constraints", lambda value: ProjectedSystem(lambda x: x, constraints=value)),
    (
        "constraint_gradients",
        lambda value: ProjectedSystem(lambda x: x, constraints=lambda x: x, constraint_gradients=value),
    ),
    *[("x", getattr(K, name)) for K in (BOX, DISC) for name in ("velocity", "inward_normals", "projection")],
    ("start", DISC.equilibrium),
    *by_name(saturation, "gain", "limit"),
    *by_name(dead_zone, "width", "gain"),
    *by_name(relay_step, "lower", "upper"),
    *by_name(coulomb_friction, "level", "viscosity"),
    *by_name(lambda **given: resistor(**{"voltages": [1], "currents": [1], "left_conductance": 1,
                                         "right_conductance": 1, **given}), "voltages", "currents"),
    ("left_slope", lambda value: resistor([1], [1], value, 1)),
    *by_name(lambda **given: gain_schedule(**{"thresholds": [1], "gains": [1, 2], **given}),
             "thresholds", "gains", "offsets"),
    *by_name(lambda **given: Characteristic(**{"points": [(0, 1)], **given}),
             "points", "left_slope", "right_slope"),
    ("y", saturation()),
    ("y", lambda value: saturation().distance(value, 1.0)),
    ("u", lambda value: saturation().distance(1.0, value)),
    *by_name(lambda **given: ControlAffineProblem(**{**CONTROL, **given}), *CONTROL, "final_reward"),
    *by_name(ControlAffineProblem(**CONTROL).solve, "intervals", "tolerance", "start"),
]  # fmt: skip


@pytest.mark.parametrize(("field", "take"), TAKEN, ids=[f"{i} {field}" for i, (field, _) in enumerate(TAKEN)])
@pytest.mark.parametrize("value", WRONG)
def test_a_value_of_the_wrong_kind_is_refused_by_name(field, take, value):
    with pytest.raises(InvalidInputError, match=rf"^{field}\b.* must be "):
        take(value)


@pytest.mark.parametrize("value", ["x", -1, 0, 2.5, True])
def test_iterations_are_counted_by_whole_numbers(value):
    with pytest.raises(InvalidInputError, match=r"max_iterations = .* whole number"):
        ControlAffineProblem(**CONTROL).solve(intervals=4, max_iterations=value)


@pytest.mark.parametrize("x", [[], [1.0], [1.0, 2.0, 3.0]])
def test_points_have_as_many_numbers_as_the_set(x):
    for take in (BOX.velocity, BOX.inward_normals, BOX.projection):
        with pytest.raises(InvalidInputError, match=r"x = .* vector of length 2"):
            take(x)
    free = ProjectedSystem(lambda x: x, ONE, [0, 0])
    with pytest.raises(InvalidInputError, match=r"x = .* vector of length 2"):
        free.projection(x)


def test_a_system_without_coordinates_is_refused():
    none = np.zeros((0, 0))
    with pytest.raises(InvalidInputError, match=r"mass = .* at least one row"):
        MechanicalSystem(none, none, none, np.zeros((1, 0)))


def test_a_constraint_without_normal_has_none():
    """The first row says 0 >= 0."""
    system = ProjectedSystem((ONE, [1, 2]), [[0, 0], [2, 0]], [0, 0])
    assert system.inward_normals([0, 1]).tolist() == [[1.0, 0.0]]


def test_gradients_beside_a_polyhedron_are_refused():
    with pytest.raises(InvalidInputError, match=r"constraint_gradients = .* left out with H and h"):
        ProjectedSystem((ONE, [1, 2]), ONE, [0, 0], constraint_gradients=lambda x: -ONE)


@pytest.mark.parametrize("times", [[0.5, 0.25], [-0.5], [0.5, 1.5]])
def test_times_to_report_increase_inside_the_interval_in_steps_too(times):
    with pytest.raises(InvalidInputError, match=r"t_eval = .* increasing and inside"):
        in_the_box(t_eval=times)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, np.uint8])
def test_numpy_numbers_are_taken_as_those_of_python(kind):
    one, two = kind(1), kind(2)
    assert saturation(one, two).points.tolist() == [[-2.0, -2.0], [2.0, 2.0]]
    assert dead_zone(two, one).points.tolist() == [[-2.0, 0.0], [2.0, 0.0]]
    assert coulomb_friction(two, one).right_slope == -1.0
    assert Characteristic([[one, two]], two).left_slope == 2.0
    assert Characteristic([(0, Fraction(1, 2))], Fraction(1, 2)).left_slope == 0.5
    assert ball(mass=[[two]], restitution=one).restitution == 1.0
    fall = thrown(q0=[one], t_span=(kind(0), two), t_eval=[one])
    assert np.array_equal(fall.x, thrown(q0=[1], t_span=(0, 2), t_eval=[1]).x)
    stepped = in_the_box(t_span=(kind(0), one), method=TimeStepping(tolerance=np.float32(0.5)))
    assert np.array_equal(stepped.x, in_the_box().x)
