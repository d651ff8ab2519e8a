from functools import cache

import pytest

from benchmarks.max_plus import HIDDEN_MEAN, KINDS, Sizes, findings, graph_of, measure, run
from pricing_core.max_plus import eigenvalue, exact
from pricing_core.max_plus.matrices import dense

TINY = Sizes("A tiny run.", (10, 30), (10, 30), 1)


@cache
def measured(kind):
    return measure(kind, TINY)


@pytest.mark.parametrize("kind", KINDS)
def test_both_methods_find_the_same_mean_on_every_kind_of_graph(kind):
    howard, karp = ([r for r in measured(kind) if r.method == name] for name in ("howard", "karp"))
    assert [r.value for r in howard] == pytest.approx([r.value for r in karp], rel=1e-12)


def test_the_hidden_mean_is_the_exact_answer():
    assert eigenvalue(exact(dense(graph_of("hidden ring", 20)))) == HIDDEN_MEAN


def test_the_sentences_are_computed_from_the_measurements():
    runs = [r for kind in KINDS for r in measured(kind)]
    sentences = " ".join(findings(runs))
    assert "for 30 nodes" in sentences
    assert "found to 0;" in sentences


def test_a_quick_run_reports_every_measurement():
    report = run(quick=True)
    (table,) = report.sections[-1].tables
    assert len(table.rows) == 12
    assert report.sections[0].text.startswith("A quick run")
