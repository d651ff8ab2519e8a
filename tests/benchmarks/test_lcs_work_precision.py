"""The benchmark of linear complementarity systems: its exact states, and what it measures."""

import numpy as np
import pytest

from benchmarks.lcs.problems import PROBLEMS, filtered_bridge, integer_system, passive_network
from benchmarks.lcs.study import EVENT_DRIVEN, study_large, study_problem
from benchmarks.lcs_work_precision import run
from pricing_core.lcs import passivity, simulate


@pytest.mark.parametrize("name", PROBLEMS)
def test_event_driven_simulation_meets_the_exact_states(name: str) -> None:
    problem = PROBLEMS[name]()
    assert problem.name == name
    found = simulate(problem.system, problem.x0, (0.0, problem.times[-1]), t_eval=problem.times)
    assert problem.error(found.x) < 1e-11


def test_the_filtered_bridge_has_the_published_states() -> None:
    exact = filtered_bridge().exact
    assert exact[0, 0] == pytest.approx(7.686097103377391, rel=1e-12)
    assert exact[-1] == pytest.approx([4.096759706332225, 0.0639902632531, 5.747070622528], rel=1e-11)


def test_a_tighter_tolerance_costs_steps_and_brings_accuracy() -> None:
    driven, *stepped = study_problem(PROBLEMS["diode bridge"](), (1e-2, 1e-4))
    assert (driven.method, driven.tolerance) == (EVENT_DRIVEN, None)
    assert driven.error < 1e-11
    for loose, tight in zip(stepped[::2], stepped[1::2], strict=True):
        assert loose.method == tight.method
        assert tight.steps > loose.steps
        assert driven.error < tight.error < loose.error


def test_the_random_network_is_passive_and_the_integer_systems_are_integer() -> None:
    assert passivity(passive_network(6, 2)).verdict is not False
    system = integer_system(3, 2, "dominant")
    assert all(matrix.dtype.kind == "i" for matrix in system.given)
    assert np.all(np.linalg.eigvalsh(system.D + system.D.T) > 0.0)
    assert not integer_system(3, 2, "no feedthrough").D.any()


def test_large_systems_are_answered() -> None:
    stepped, *reports = study_large(10, 3, 20, 2)
    assert (stepped.n, stepped.k) == (10, 3)
    assert {report.answer for report in reports} <= {"well-posed", "ill-posed", "unknown"}


@pytest.mark.nightly
def test_the_quick_report_holds_every_system_and_method() -> None:
    report = run(quick=True)
    assert {(row[0], row[1]) for row in report.sections[0].tables[0].rows} >= {
        ("diode bridge", EVENT_DRIVEN),
        ("two carts", "implicit-euler"),
        ("two relays", "sdirk2"),
    }
    assert "from event to event" in report.sections[0].text
