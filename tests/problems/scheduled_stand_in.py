"""What stands in for the pricing of options with events, where a test is about the doors to it."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from pricing_core.american import Market, Option
from pricing_core.american.price_many import NUMBERS


class ScheduledStandIn:
    """Gives the numbers k to the k-th of its options, 0.5 as the sensitivity to each dividend, and keeps its calls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls: list[Any] = []
        self.reason = ""  # why it gives no price, if it gives none
        module = sys.modules["pricing_core.american.price_many"]  # whose name the function has taken
        monkeypatch.setattr(module, "price_scheduled_many", self.price_scheduled_many)

    def price_scheduled_many(
        self, contracts: list[tuple[Option, Market]], tolerance: list[float], *, greeks: bool, threads: int
    ) -> list[SimpleNamespace]:
        """Take the place of the function of that name."""
        self.calls.append((contracts, tolerance, greeks, threads))
        return [
            SimpleNamespace(
                **dict.fromkeys(NUMBERS, float(k))
                | {"vega": None}
                | ({"price": None} if self.reason else {}),
                exercise_now=k == 1,
                status="out_of_domain" if self.reason else "ok",
                diagnostics=SimpleNamespace(solved_by=self.reason),
                method="stand-in",
                engine_version="0",
                dividend_sensitivities=tuple(0.5 for _ in market.cash_dividends) or None,
            )
            for k, (_, market) in enumerate(contracts)
        ]
