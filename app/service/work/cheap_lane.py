"""Cheap prices, on the event loop itself: those that wait at the same time go into one call of the engines."""

import asyncio
import functools
from collections import defaultdict, deque
from typing import NamedTuple

from app.service.work.cost_model import CHEAP_SECONDS
from app.service.work.lanes import INLINE_SECONDS, inline, processor_limit
from pricing_core.american import Market, Option, Valuation
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.price_together import price_together

MOST_TOGETHER = 32  # prices in one call, after which the loop sees to its connections again; chosen
MOST_SECONDS = (
    10.0 * CHEAP_SECONDS
)  # that they would take one by one: together they are several times as fast; chosen


class _Asked(NamedTuple):
    contract: tuple[Option, Market]
    book: Book
    tolerance: float
    seconds: float
    answer: asyncio.Future[Valuation | None]
    alone: bool = False


class CheapLane:
    """Prices together what came in during two turns of the event loop; only the loop's thread may call it."""

    def __init__(self) -> None:
        self._waiting: defaultdict[Greeks, deque[_Asked]] = defaultdict(deque)

    async def price(
        self, contract: tuple[Option, Market], book: Book, tolerance: float, greeks: Greeks, seconds: float
    ) -> Valuation | None:
        """Return the price that is expected to take so many seconds, None where it takes much longer.

        Parameters
        ----------
        book : Book
            A book of the one contract.
        """
        loop = asyncio.get_running_loop()
        asked = _Asked(contract, book, tolerance, seconds, loop.create_future())
        waiting = self._waiting[greeks]
        waiting.append(asked)
        if len(waiting) == 1:
            loop.call_soon(loop.call_soon, self._price_some, greeks)  # two turns on: more are there by then
        return await asked.answer

    def _price_some(self, greeks: Greeks) -> None:
        """Price the first of those that wait, and leave the others to the next turn."""
        waiting = self._waiting[greeks]
        now = [waiting.popleft()]
        seconds = now[0].seconds
        while waiting and not (now[0].alone or waiting[0].alone or len(now) == MOST_TOGETHER):
            seconds += waiting[0].seconds
            if seconds > MOST_SECONDS:
                break
            now.append(waiting.popleft())
        for asked, valuation in zip(now, _priced(now, greeks, INLINE_SECONDS + seconds), strict=True):
            if valuation is None and len(now) > 1:  # perhaps for what another one took
                waiting.append(asked._replace(alone=True))
            elif not asked.answer.done():
                asked.answer.set_result(valuation)
        if waiting:
            asyncio.get_running_loop().call_soon(self._price_some, greeks)


def _priced(now: list[_Asked], greeks: Greeks, seconds: float) -> list[Valuation | None]:
    contracts, books, tolerances = zip(*((one.contract, one.book, one.tolerance) for one in now), strict=True)
    work = functools.partial(price_together, contracts, Book.concatenated(books), tolerances, greeks)
    try:
        # What was interrupted may be less exact than an undisturbed answer, and is not given.
        return inline(work, processor_limit(seconds)) or [None] * len(now)
    except Exception:  # one of them is to blame: each is asked again, alone
        return [None] * len(now)
