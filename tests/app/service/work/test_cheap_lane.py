"""The lane of cheap prices: each answer is what `price` says, whoever else is asked about in the same call."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import numpy as np
import pytest

from app.service.work import cheap_lane
from app.service.work.cheap_lane import MOST_TOGETHER, CheapLane
from app.service.work.cost_model import CHEAP_SECONDS
from pricing_core.american import Market, Option, Valuation, price
from pricing_core.american.book.book import Book
from tests.problems.needs_kernel import needs_kernel

Result = TypeVar("Result")
pytestmark = [needs_kernel, pytest.mark.usefixtures("unhurried")]
CHEAP = 1e-3  # seconds that each is expected to take


def in_a_lane(scenario: Callable[[CheapLane], Awaitable[Result]]) -> Result:
    async def run() -> Result:
        return await asyncio.wait_for(scenario(CheapLane()), 60.0)

    return asyncio.run(run())


def contracts(count: int) -> list[tuple[Option, Market, float, Any]]:
    rng = np.random.default_rng(5)
    return [
        (
            Option("put" if rng.random() < 0.5 else "call", 100.0, float(rng.uniform(0.1, 2.0))),
            Market(float(rng.uniform(80.0, 120.0)), 0.05, float(rng.uniform(0.1, 0.5)), 0.02),
            float(rng.choice([1e-4, 1e-6])),
            str(rng.choice(["none", "standard", "extended"])),
        )
        for _ in range(count)
    ]


def test_prices_together_are_those_of_each_alone_in_several_rounds() -> None:
    asked = contracts(60)

    async def scenario(lane: CheapLane) -> list[Valuation | None]:
        found: list[Valuation | None] = []
        for start in range(0, len(asked), 20):
            some = asked[start : start + 20]
            found += await asyncio.gather(
                *(
                    lane.price((o, m), Book.of([(o, m)]), tolerance, greeks, CHEAP)
                    for o, m, tolerance, greeks in some
                )
            )
        return found

    found = in_a_lane(scenario)
    for (option, market, tolerance, greeks), valuation in zip(asked, found, strict=True):
        if valuation is not None:  # else another engine would be asked
            assert valuation == price(option, market, tolerance=tolerance, greeks=greeks)
    assert sum(valuation is not None for valuation in found) > 50


def test_one_that_takes_much_longer_than_it_was_expected_to_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cheap_lane, "INLINE_SECONDS", -1.0)
    contract = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)

    async def scenario(lane: CheapLane) -> Valuation | None:
        return await lane.price(contract, Book.of([contract]), 1e-4, "standard", CHEAP)

    assert in_a_lane(scenario) is None


def test_one_that_fails_or_is_no_longer_wanted_costs_nobody_else_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = cheap_lane.price_together

    def failing(some: Any, *others: Any) -> Any:
        if any(option.strike == 13.0 for option, _ in some):
            raise ValueError("an unlucky strike")
        return together(some, *others)

    monkeypatch.setattr(cheap_lane, "price_together", failing)
    good, market = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)

    async def scenario(lane: CheapLane) -> tuple[list[Valuation | None], Valuation | None]:
        options = [good, Option("put", 13.0, 1.0), good, good]
        tasks = [
            asyncio.ensure_future(lane.price((o, market), Book.of([(o, market)]), 1e-4, "standard", CHEAP))
            for o in options
        ]
        await asyncio.sleep(0.0)
        tasks[2].cancel()
        found = await asyncio.gather(*(tasks[k] for k in (0, 1, 3)))
        return found, await lane.price((good, market), Book.of([(good, market)]), 1e-4, "standard", CHEAP)

    (first, failed, last), later = in_a_lane(scenario)
    assert failed is None
    assert first == last == later == price(good, market, tolerance=1e-4)


@pytest.mark.parametrize(("seconds", "most"), [(1e-6, MOST_TOGETHER), (CHEAP_SECONDS, 10)])
def test_one_call_prices_a_bounded_number(monkeypatch: pytest.MonkeyPatch, seconds: float, most: int) -> None:
    together = []
    monkeypatch.setattr(
        cheap_lane, "_priced", lambda now, *_: (together.append(len(now)), [None] * len(now))[1]
    )
    contract = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)

    async def scenario(lane: CheapLane) -> None:
        book = Book.of([contract])
        await asyncio.gather(*(lane.price(contract, book, 1e-4, "none", seconds) for _ in range(100)))

    in_a_lane(scenario)
    assert max(together) <= most
