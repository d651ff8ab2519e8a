"""Cheap prices, on the event loop itself: those that wait at the same time go into one call of the engines."""

import asyncio
import time
from collections import defaultdict
from typing import NamedTuple

from app.lanes import INLINE_SECONDS
from pricing_core.american import Market, Option, Valuation
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.price_together import price_together

MOST_TOGETHER = 32  # prices in one call, after which the loop sees to its connections again; chosen


class _Asked(NamedTuple):
    option: Option
    market: Market
    tolerance: float
    answer: asyncio.Future[Valuation | None]


class CheapLane:
    """Prices what came in during one turn of the event loop in the next. Only its thread may call the methods."""

    def __init__(self) -> None:
        self._waiting: defaultdict[Greeks, list[_Asked]] = defaultdict(list)

    async def price(
        self, option: Option, market: Market, tolerance: float, greeks: Greeks
    ) -> Valuation | None:
        """Return the price, None where it is not to be had in a few milliseconds."""
        loop = asyncio.get_running_loop()
        asked = _Asked(option, market, tolerance, loop.create_future())
        waiting = self._waiting[greeks]
        if not waiting:
            loop.call_soon(self._price_all, greeks)
        waiting.append(asked)
        return await asked.answer

    def _price_all(self, greeks: Greeks) -> None:
        waiting = self._waiting[greeks]
        now, later = waiting[:MOST_TOGETHER], waiting[MOST_TOGETHER:]
        self._waiting[greeks] = later
        if later:
            asyncio.get_running_loop().call_soon(self._price_all, greeks)
        for asked, valuation in zip(now, _priced(now, greeks), strict=True):
            if not asked.answer.done():
                asked.answer.set_result(valuation)


def _priced(now: list[_Asked], greeks: Greeks) -> list[Valuation | None]:
    end = time.monotonic() + INLINE_SECONDS
    contracts = [(asked.option, asked.market) for asked in now]
    tolerances = [asked.tolerance for asked in now]
    try:
        return price_together(contracts, tolerances, greeks, lambda: time.monotonic() > end)
    except Exception:  # one of them is to blame: each is asked again, alone and in a thread
        return [None] * len(now)
