"""The reports on books in files, on clusters and on the service, from small measurements."""

import pytest

from benchmarks import batch_throughput, cluster_scaling, service_load
from benchmarks.service_load import Arrivals, ClosedLoop


@pytest.mark.nightly  # `make benchmark` measures more of the same
def test_a_book_is_priced_as_arrays_and_from_every_kind_of_file() -> None:
    runs = batch_throughput.measure(200, (1,))
    assert [(run.kind, run.threads) for run in runs] == [("price_many", 1), ("parquet", 1), ("csv", 1)]
    assert all(run.rows_a_second == pytest.approx(200 / run.seconds) and run.peak_MB > 10.0 for run in runs)
    assert runs[1].over_price_many == pytest.approx(runs[1].seconds / runs[0].seconds)
    (section,) = [batch_throughput._section("Flat", "flat", runs)]
    fastest = max(runs[1:], key=lambda run: run.rows_a_second)
    assert section.paragraphs[0].startswith(f"{fastest.kind.capitalize()} on 1 thread is the fastest file")


@pytest.mark.nightly  # `make benchmark` measures more of the same
def test_a_cluster_is_held_against_one_thread() -> None:
    alone, one = cluster_scaling.measure(200, (1,))
    assert (alone.who, alone.efficiency) == ("one thread", None)
    assert (one.who, one.efficiency) == ("1 worker", 1.0)
    section = cluster_scaling._section("Flat", "flat", [alone, one])
    assert "The most, 1 worker, price" in section.paragraphs[0]
    assert [len(axes.lines) for axes in section.figures["flat"].axes] == [2]


@pytest.mark.nightly
def test_the_service_is_held_against_its_own_constant_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_load, "CLIENTS", (2,))
    loops, arrivals = service_load.run(quick=True).tables
    (row,) = loops.records
    assert row["clients"] == 2
    assert all(
        isinstance(cell, float | int) and cell > 0.0 for name, cell in row.items() if "added" not in name
    )
    assert [row["other answers"] for row in arrivals.records] == ["none", "none"]


def test_the_sentences_on_the_service_follow_from_its_figures() -> None:
    loops = [
        ClosedLoop(1, 1000.0, 0.5, 0.9, 1.4, 0.4, 5000.0),
        ClosedLoop(8, 1300.0, 0.6, 6.0, 9.0, 2.0, 9000.0),
    ]
    (told,) = service_load._loop_section(loops).paragraphs
    assert "At most 1,300 prices a second, with 8 clients, which is 0.60" in told
    assert "a price adds 0.40 ms" in told
    beside = [
        Arrivals(what, 20.0, 20.0, median, 9.0, "none") for what, median in (("alone", 1.0), ("idle", 3.0))
    ]
    (told,) = service_load._hostile_section(beside).paragraphs
    assert "waits 1 ms in the median; 3 ms in the worst company: idle." in told
