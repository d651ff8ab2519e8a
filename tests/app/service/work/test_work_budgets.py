import numpy as np
import pytest

from app.service.errors import ClientLimitError
from app.service.work.work_budgets import WorkBudgets


def test_a_client_uses_what_it_may_and_no_more_however_it_asks() -> None:
    rng = np.random.default_rng(11)
    for _ in range(20):
        now, used, end = 0.0, 0.0, float(rng.uniform(100.0, 1000.0))
        per_minute, piece = float(rng.uniform(1.0, 60.0)), float(rng.uniform(0.1, 5.0))
        budgets = WorkBudgets(lambda: now)  # noqa: B023
        while now < end:
            try:
                budgets.check("a", per_minute)
            except ClientLimitError as refused:
                now += refused.retry_after or 0.0
                budgets.check("a", per_minute)  # what it was told is true
            seconds = float(rng.uniform(0.0, piece))
            budgets.spend("a", per_minute, seconds)
            used += seconds
            now += float(rng.exponential(0.1))
        assert used <= per_minute * (1.0 + now / 60.0) + piece
        assert used >= 0.5 * per_minute * now / 60.0 or piece < per_minute / 60.0


def test_one_client_s_use_is_not_another_s() -> None:
    budgets = WorkBudgets(lambda: 0.0)
    budgets.spend("a", 1.0, 5.0)
    with pytest.raises(ClientLimitError, match="which is its limit"):
        budgets.check("a", 1.0)
    budgets.check("b", 1.0)
