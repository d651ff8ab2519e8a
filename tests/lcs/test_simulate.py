import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, EventDriven, TimeStepping, simulate
from tests.problems.lcs_problems import falling_ball, problems

SYSTEM = LCS([[-1.0]], [[1.0]], [[1.0]])


@pytest.mark.parametrize("problem", problems(), ids=lambda p: p.name)
def test_both_methods_give_the_same_trajectory(problem):
    span = (0.0, max(problem.times))
    driven = simulate(problem.system, problem.x0, span, t_eval=problem.times)
    stepped = simulate(
        problem.system,
        problem.x0,
        span,
        method=TimeStepping(tolerance=0.0, absolute_tolerance=1e-6 * np.array(problem.scale)),
        t_eval=problem.times,
    )
    distance = np.max(np.abs(driven.x - stepped.x) / problem.scale)
    assert distance < (5e-3 if problem.relative_degree == 2 else 2e-4)


@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("x0", {"x0": [1.0, 2.0]}),
        ("x0", {"x0": [np.nan]}),
        ("t_span", {"t_span": (1.0, 0.0)}),
        ("t_span", {"t_span": (0.0, np.inf)}),
        ("t_span", {"t_span": 3.0}),
        ("method", {"method": "guessing"}),
        ("t_eval", {"t_eval": [2.0]}),
        ("t_eval", {"t_eval": [0.5, 0.4]}),
        (
            "rebound",
            {
                "system": LCS([[-1.0]], [[1.0]], [[1.0]], [[1.0]]),
                "method": EventDriven(rebound=lambda *states: states),
            },
        ),
    ],
)
def test_bad_arguments_are_refused(field, arguments):
    given = {"system": SYSTEM, "x0": [1.0], "t_span": (0.0, 1.0), **arguments}
    with pytest.raises(InvalidInputError, match=field):
        simulate(**given)


def test_a_refined_trajectory_agrees_with_its_own_flow() -> None:
    problem = falling_ball()
    trajectory = simulate(problem.system, problem.x0, (0.0, 1.0))
    fine = trajectory.refined(200)
    assert 200 <= fine.t.size <= 210
    assert fine.x == pytest.approx(np.array([problem.exact(t) for t in fine.t]), abs=5.0)
    smooth = fine.t != trajectory.events[0].time
    assert fine.x[smooth] == pytest.approx(np.array([problem.exact(t) for t in fine.t[smooth]]), abs=1e-12)
    stepped = simulate(problem.system, problem.x0, (0.0, 1.0), method="time-stepping")
    assert stepped.refined(200) is stepped
