"""The attack on a real server: every kind is tried, a neighbour is answered, and memory stays within its bound."""

import pytest

from benchmarks import service_attack
from benchmarks.serving.attackers import EVERYTHING, shapes
from benchmarks.serving.load import server_process
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
MOST_MEGABYTES = 700.0  # of two workers and their parent, pages that they share counted once


@pytest.mark.nightly
def test_some_attacks_are_tried_and_told() -> None:
    report = service_attack.run(quick=True)
    (attacks,) = report.tables
    assert [row["attack"] for row in attacks.records] == ["nobody", *[*shapes()][::5]]
    assert all(row["refused"] == 0 and row["megabytes"] < MOST_MEGABYTES for row in attacks.records)


@pytest.mark.nightly
def test_no_attack_takes_the_memory_or_the_neighbours_answers() -> None:
    with server_process(service_attack.TWO_WORKERS) as (port, process):
        service_attack.until_ready(port)
        for row in service_attack.attacks([*shapes()], port, process, 25.0, (128,)):
            assert row.refused == 0, row
            assert row.megabytes < MOST_MEGABYTES, row


@pytest.mark.nightly
def test_all_attacks_together_for_ten_minutes_take_no_more_than_one() -> None:
    with server_process(service_attack.TWO_WORKERS) as (port, process):
        service_attack.until_ready(port)
        row = service_attack.beside(
            EVERYTHING, service_attack.MANY, port, process, service_attack.LONG_SECONDS
        )
    assert row.refused == 0, row
    assert row.megabytes < MOST_MEGABYTES, row
