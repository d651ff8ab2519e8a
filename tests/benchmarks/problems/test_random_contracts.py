import math

import pytest

from benchmarks.greeks import ENGINES
from benchmarks.problems import random_contracts as kinds
from benchmarks.problems.cost_sweeps import BOOKS
from benchmarks.problems.random_contracts import rows_of
from pricing_core.american import contract_from

KINDS = {*BOOKS.values(), *(kind for each in ENGINES.values() for kind in each)}


@pytest.mark.parametrize(
    "kind", sorted(KINDS, key=lambda kind: kind.__name__), ids=lambda kind: kind.__name__
)
def test_every_contract_is_valid_and_its_dividends_fall_into_its_life(kind: kinds.Kind) -> None:
    for row in rows_of(kind, 20):
        option, market = contract_from(row)
        paid = [each.time for each in (*market.cash_dividends, *market.proportional_dividends)]
        assert all(0.0 <= time < option.expiry for time in paid)


def test_weekly_dividends_are_sixty_and_a_week_apart() -> None:
    (row,) = rows_of(kinds.weekly, 1)
    times = [each["time"] for each in row["cash_dividends"]]
    assert len(times) == 60
    assert math.isclose(times[-1] - times[0], 59 * kinds.WEEK)


def test_hours_are_hours() -> None:
    for row in rows_of(kinds.hours_to_expiry_and_ex_date, 20):
        assert kinds.HOUR <= row["expiry"] <= 48 * kinds.HOUR
        assert 0.0 < row["cash_dividends"][0]["time"] < row["expiry"]
    for row in rows_of(kinds.hours_to_ex_date, 20):
        assert kinds.HOUR <= row["cash_dividends"][0]["time"] <= 48 * kinds.HOUR
