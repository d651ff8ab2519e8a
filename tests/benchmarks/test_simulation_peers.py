import math

import numpy as np
import pytest

from benchmarks import simulation_peers
from benchmarks.lcs.peer_problems import Beads, beads, dry_friction, regulated_converter
from benchmarks.simulation_peers import PeerRun
from pricing_core.lcs import TimeStepping, simulate


def test_dry_friction_has_its_closed_form() -> None:
    problem = dry_friction()
    span = (0.0, float(problem.times[-1]))
    assert problem.error(simulate(problem.system, problem.x0, span, t_eval=problem.times).x) < 1e-13


def test_a_bead_alone_bounces_as_in_textbooks() -> None:
    """Down for sqrt(2 h/g); up again to e**2 h after e sqrt(2 h/g) more."""
    fall = math.sqrt(2.0 / 9.81)
    top = Beads(np.array([1.0]), np.array([0.0]), 0.8, np.array([fall * 1.8])).exact[0]
    assert top == pytest.approx([0.64, 0.0], abs=1e-12)


def test_beads_collide_as_the_mechanical_model_lets_them() -> None:
    column = beads()
    run = column.system().simulate(
        column.heights, column.velocities, (0.0, float(column.times[-1])), t_eval=column.times
    )
    assert run.x == pytest.approx(column.exact, abs=1e-12)
    assert len(run.events) > 20


def test_the_regulated_converter_is_what_steps_approach() -> None:
    problem = regulated_converter()
    times = problem.times[:1]
    errors = []
    for h in (1e-9, 5e-10):
        run = simulate(
            problem.system,
            problem.x0,
            (0.0, times[-1]),
            method=TimeStepping("implicit-euler", step=h),
            t_eval=times,
        )
        errors.append(float(np.max(np.abs(run.x - problem.exact[:1]) / problem.scale)))
    assert errors[0] < 5e-3
    assert errors[1] < 0.7 * errors[0]


def test_a_peer_that_is_not_installed_is_said_to_be_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PRICING_SICONOS_PYTHON", raising=False)
    found = simulation_peers._peer("beads", "Siconos", 1e-3, {}, lambda _: 0.0)
    assert (found.error, found.remark) == (None, "not installed")


def test_a_report_has_a_sentence_and_a_panel_for_each_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    def some(problem: str) -> list[PeerRun]:
        return [
            PeerRun(problem, "event-driven", None, 0.01, 0.0),
            PeerRun(problem, "implicit-euler", 1e-3, 0.1, 1e-2),
            PeerRun(problem, "Siconos", 1e-3, 0.02, 1e-2),
            PeerRun(problem, "nosnoc", 1e-3, None, None, "not installed"),
        ]

    monkeypatch.setattr(simulation_peers, "PROBLEMS", dict.fromkeys(simulation_peers.PROBLEMS, dry_friction))
    names = iter(simulation_peers.STEPS)
    monkeypatch.setattr(simulation_peers, "_of_system", lambda *_: some(next(names)))
    monkeypatch.setattr(simulation_peers, "_of_beads", lambda _: some("beads"))
    report = simulation_peers.run(quick=True)
    section = report.sections[0]
    assert len(section.tables[0].rows) == 4 * len(simulation_peers.STEPS)
    text = " ".join(section.paragraphs)
    assert "Dry friction: from event to event 10.0 ms, for 0.0e+00; at best implicit-euler 100 ms" in text
    assert len(section.figures["peers"].axes) == 6
