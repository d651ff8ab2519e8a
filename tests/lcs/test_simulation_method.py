"""The choices of the two ways to simulate: what is refused, and that every one has an effect."""

from dataclasses import FrozenInstanceError, fields
from fractions import Fraction

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, IterationLimitError, NonUniqueError
from pricing_core.lcs import LCS, EventDriven, TimeStepping, simulate
from tests.problems.lcs_problems import diode_bridge, falling_ball, problems

CONSTANT = {"step": 0.1}


@pytest.mark.parametrize(
    ("make", "given", "sentence"),
    [
        (
            EventDriven,
            {"on_nonunique": "last"},
            'on_nonunique = \'last\': must be "raise", "first" or a function',
        ),
        (EventDriven, {"on_nonunique": None}, "on_nonunique = None: must be"),
        (EventDriven, {"on_nonunique": np.array(["raise", "first"])}, "on_nonunique = "),
        (EventDriven, {"max_events": -1}, "max_events = -1: must be a whole number >= 0"),
        (EventDriven, {"max_events": 2.0}, "max_events = 2.0: must be a whole number"),
        (EventDriven, {"max_events": True}, "max_events = True: must be a whole number"),
        (EventDriven, {"rebound": 0.5}, "rebound = 0.5: must be a function of the states"),
        (TimeStepping, {"scheme": "heun"}, 'scheme = \'heun\': must be one of "auto", "implicit-euler", '),
        (TimeStepping, {"scheme": ["theta"]}, "scheme = "),
        (TimeStepping, {"theta": 0.5}, 'theta = 0.5: must be left out unless scheme is "theta" or "moreau"'),
        (TimeStepping, {"scheme": "sdirk2", "theta": 1.0}, "theta = 1.0: must be left out"),
        (TimeStepping, {"scheme": "theta", "theta": 0.4}, "theta = 0.4: must be at least 1/2 and at most 1"),
        (TimeStepping, {"scheme": "theta", "theta": 1.1}, "theta = 1.1: must be at least"),
        (TimeStepping, {"scheme": "theta", "theta": np.nan}, "theta = nan: must be a number"),
        (TimeStepping, {"step": 0.0}, "step = 0.0: must be a number > 0"),
        (TimeStepping, {"step": -1}, "step = -1: must be a number > 0"),
        (TimeStepping, {"step": np.nan}, "step = nan: must be a number"),
        (TimeStepping, {"tolerance": -1e-9}, "tolerance = -1e-09: must be a finite number >= 0"),
        (TimeStepping, {"tolerance": np.inf}, "tolerance = inf: must be a finite number"),
        (TimeStepping, {"absolute_tolerance": 0.0}, "absolute_tolerance = 0.0: must be > 0"),
        (
            TimeStepping,
            {"absolute_tolerance": [1.0, -1.0]},
            r"absolute_tolerance = \[1.0, -1.0\]: must be > 0",
        ),
        (TimeStepping, {"absolute_tolerance": [[1.0]]}, "absolute_tolerance = .*: must be a vector"),
        (
            TimeStepping,
            {**CONSTANT, "tolerance": 1e-3},
            "tolerance = 0.001: must be left out with a constant step",
        ),
        (TimeStepping, {**CONSTANT, "absolute_tolerance": 1.0}, "absolute_tolerance = 1.0: must be left out"),
        (
            TimeStepping,
            {"lcp_method": "simplex"},
            'lcp_method = \'simplex\': must be one of "auto", "lemke", ',
        ),
        (TimeStepping, {"lcp_method": None}, "lcp_method = None: must be one of"),
        (
            TimeStepping,
            {"multipliers": "small"},
            'multipliers = \'small\': must be one of "any", "least-norm"',
        ),
    ],
)
def test_a_choice_outside_what_is_allowed_is_refused_by_name(make, given, sentence):
    with pytest.raises(InvalidInputError, match=f"^{sentence}"):
        make(**given)


@pytest.mark.parametrize(
    "method",
    ["event driven", "EVENT-DRIVEN", "", None, EventDriven, TimeStepping, {"step": 1}, np.array(["a", "b"])],
)
def test_what_is_no_method_is_refused(method):
    with pytest.raises(
        InvalidInputError, match=r'^method = .* must be "event-driven", "time-stepping", an Event'
    ):
        simulate(LCS([[-1.0]], [[1.0]], [[1.0]]), [1.0], (0.0, 1.0), method=method)


def test_a_tolerance_for_each_state_has_as_many_numbers():
    with pytest.raises(InvalidInputError, match=r"absolute_tolerance = .* vector of length 1"):
        simulate(
            LCS([[-1.0]], [[1.0]], [[1.0]]),
            [1.0],
            (0.0, 1.0),
            method=TimeStepping(absolute_tolerance=[1e-6, 1e-6]),
        )


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
@pytest.mark.parametrize(
    ("name", "method"), [("event-driven", EventDriven()), ("time-stepping", TimeStepping())]
)
def test_a_name_stands_for_the_method_with_its_defaults(problem, name, method):
    span = (0.0, max(problem.times))
    by_name, by_object = (
        simulate(problem.system, problem.x0, span, method=given) for given in (name, method)
    )
    for part in ("t", "x", "u", "y"):
        assert np.array_equal(getattr(by_name, part), getattr(by_object, part))
    assert [event.time for event in by_name.events] == [event.time for event in by_object.events]


def test_a_method_is_a_value():
    method = TimeStepping("theta", theta=Fraction(3, 4), absolute_tolerance=np.array([1, 2]))
    assert method == TimeStepping("theta", theta=0.75, absolute_tolerance=(1.0, 2.0))
    assert len({method, TimeStepping(), TimeStepping("auto"), EventDriven(), EventDriven("raise")}) == 3
    with pytest.raises(FrozenInstanceError):
        method.theta = 1.0


def test_the_tolerances_are_those_that_are_told():
    controller = TimeStepping().controller(3)
    assert (controller.rtol, controller.atol) == (1e-5, 1e-8)
    problem = diode_bridge()
    span = (0.0, max(problem.times))
    told = simulate(
        problem.system, problem.x0, span, method=TimeStepping(tolerance=1e-5, absolute_tolerance=1e-8)
    )
    assert np.array_equal(told.x, simulate(problem.system, problem.x0, span, method="time-stepping").x)


# Two shelves that hold one weight together: only the sum of the multipliers matters.
SHELVES = LCS([[0.0]], [[1.0, 1.0]], [[1.0], [1.0]], f=[-1.0])
BRIDGE = diode_bridge()
EFFECTS = {
    "scheme": (BRIDGE.system, BRIDGE.x0, 1e-4, TimeStepping("implicit-euler")),
    "theta": (BRIDGE.system, BRIDGE.x0, 1e-4, TimeStepping("theta", theta=0.75)),
    "step": (BRIDGE.system, BRIDGE.x0, 1e-4, TimeStepping(step=1e-6)),
    "tolerance": (BRIDGE.system, BRIDGE.x0, 1e-4, TimeStepping(tolerance=1e-3)),
    "absolute_tolerance": (BRIDGE.system, BRIDGE.x0, 1e-4, TimeStepping(absolute_tolerance=[1e-2, 1e-5])),
    "multipliers": (SHELVES, [0.5], 1.0, TimeStepping(multipliers="least-norm")),
}


@pytest.mark.parametrize("field", EFFECTS)
def test_every_choice_of_time_stepping_has_an_effect(field):
    system, x0, end, method = EFFECTS[field]
    usual = TimeStepping("theta") if field == "theta" else TimeStepping()
    runs = [simulate(system, x0, (0.0, end), method=given) for given in (usual, method)]
    assert not all(np.array_equal(getattr(runs[0], part), getattr(runs[1], part)) for part in ("t", "x", "u"))


def test_the_method_for_the_steps_problems_is_the_one_asked_for():
    """The matrix of the bridge's problems is not tridiagonal."""
    with pytest.raises(InvalidInputError, match="tridiagonal"):
        simulate(BRIDGE.system, BRIDGE.x0, (0.0, 1e-3), method=TimeStepping(lcp_method="tridiagonal"))


def test_every_choice_of_event_driven_simulation_has_an_effect():
    either_way = LCS([[0.0]], [[-2.0]], [[1.0]], f=[1.0])  # y = x, x' = 1 - 2u from 0: away, or nowhere
    with pytest.raises(NonUniqueError):
        simulate(either_way, [0.0], (0.0, 1.0))
    assert simulate(either_way, [0.0], (0.0, 1.0), method=EventDriven("first")).status == "finished"
    ball = falling_ball()
    fall = simulate(ball.system, ball.x0, (0.0, 0.6))
    back = EventDriven(rebound=lambda before, after, contacts: (after - [0, before[1]], np.zeros(1)))
    assert fall.x[-1, 0] == pytest.approx(0.0, abs=1e-12)
    assert simulate(ball.system, ball.x0, (0.0, 0.6), method=back).x[-1, 0] > 0.1
    with pytest.raises(IterationLimitError, match="0 events by t = "):
        simulate(ball.system, ball.x0, (0.0, 0.6), method=EventDriven(max_events=0))


def test_no_choice_is_left_out_of_these_tests():
    assert {field.name for field in fields(TimeStepping)} == {*EFFECTS, "lcp_method"}
    assert {field.name for field in fields(EventDriven)} == {"on_nonunique", "max_events", "rebound"}
