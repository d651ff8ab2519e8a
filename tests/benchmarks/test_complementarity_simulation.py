import numpy as np
import pytest

from benchmarks.complementarity_simulation import count, main
from benchmarks.lcs.classes import CLASSES, column, skew_feedthrough
from tests.problems.nightly import nightly

QUICK = 3


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("cases", [QUICK, pytest.param(40, marks=pytest.mark.nightly)])
def test_all_systems_of_a_class_are_simulated_rightly(name, cases):
    found = count(name, cases, 60.0)
    assert (found.refused, found.wrong, found.unfinished) == (0, 0, 0), found.first


def test_forty_pairs_with_skew_feedthrough_are_simulated():
    case = skew_feedthrough(np.random.default_rng(2), pairs=40)
    assert case.fault(case.run(lambda: False)) == ""


@pytest.mark.parametrize("beads", [10, *nightly((20, 50))])
def test_long_columns_come_to_rest(beads):
    case = column(np.random.default_rng(1), beads)
    run = case.run(lambda: False)
    assert case.fault(run) == ""
    assert any(event.kind == "zeno" for event in run.events)


def test_what_is_wrong_is_counted_with_its_seed(monkeypatch):
    def wrong(rng):
        return column(rng, 2)._replace(fault=lambda run: "too heavy")

    monkeypatch.setitem(CLASSES, "cradles", wrong)
    found = count("cradles", 2, 60.0)
    assert (found.solved, found.wrong, found.first) == (0, 2, "seed 0: too heavy")
    assert count("rocking blocks", 1, 0.0).unfinished == 1


def test_a_line_is_printed_for_every_class(monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.complementarity_simulation.CLASSES", {"cradles": CLASSES["cradles"]})
    main(1)
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["class", "cradles"]
