"""Cheap prices: one that waits alone is found on the event loop itself, several together in a thread."""

import asyncio
import functools
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from app.service.work.cost_model import CHEAP_SECONDS
from app.service.work.lanes import INLINE_SECONDS, inline, processor_limit
from pricing_core.american import Market, Option, Valuation
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.price_together import price_together

MOST_TOGETHER = 32  # prices in one call, after which the loop sees to its connections again; chosen
# That they would take one by one: together they are several times as fast; chosen.
MOST_SECONDS = 20.0 * CHEAP_SECONDS


class _Asked(NamedTuple):
    option: Option
    market: Market
    tolerance: float
    greeks: Greeks
    seconds: float
    answer: asyncio.Future[Valuation | None]
    alone: bool = False


class CheapLane:
    """Prices together what came in while others were priced. Only the event loop's thread may call the methods.

    A thread prices several at a time, and the loop reads and writes meanwhile: the kernel lets it. One alone is priced
    on the loop, without a hand-over.
    """

    def __init__(self) -> None:
        self._waiting: deque[_Asked] = deque()
        self._thread = ThreadPoolExecutor(1, "cheap")
        self._is_due = self._is_busy = False

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def price(
        self, option: Option, market: Market, tolerance: float, greeks: Greeks, seconds: float
    ) -> Valuation | None:
        """Return the price that is expected to take so many seconds, None where it takes much longer."""
        loop = asyncio.get_running_loop()
        asked = _Asked(option, market, tolerance, greeks, seconds, loop.create_future())
        self._waiting.append(asked)
        self._go_on()
        return await asked.answer

    def _go_on(self) -> None:
        """Have the next ones priced two turns of the loop on: more are there by then."""
        if self._waiting and not (self._is_due or self._is_busy):
            self._is_due = True
            loop = asyncio.get_running_loop()
            loop.call_soon(loop.call_soon, self._price_some)

    def _price_some(self) -> None:
        self._is_due = False
        now = self._next()
        if len(now) == 1:
            self._tell(now, _priced(now))
        else:
            self._is_busy = True
            done = asyncio.get_running_loop().run_in_executor(self._thread, _priced, now)
            done.add_done_callback(functools.partial(self._done, now))

    def _next(self) -> list[_Asked]:
        """Return the first of those that wait, and what goes into one call with it."""
        first = self._waiting.popleft()
        now, seconds = [first], first.seconds
        while self._waiting and not first.alone and len(now) < MOST_TOGETHER:
            seconds += self._waiting[0].seconds
            if seconds > MOST_SECONDS or self._waiting[0].alone or self._waiting[0].greeks != first.greeks:
                break
            now.append(self._waiting.popleft())
        return now

    def _done(self, now: list[_Asked], done: asyncio.Future[list[Valuation | None]]) -> None:
        self._is_busy = False
        self._tell(now, [None] * len(now) if done.cancelled() else done.result())

    def _tell(self, now: list[_Asked], found: list[Valuation | None]) -> None:
        for asked, valuation in zip(now, found, strict=True):
            if valuation is None and len(now) > 1:  # perhaps for what another one took
                self._waiting.append(asked._replace(alone=True))
            elif not asked.answer.done():
                asked.answer.set_result(valuation)
        self._go_on()


def _priced(now: list[_Asked]) -> list[Valuation | None]:
    contracts = [(asked.option, asked.market) for asked in now]
    tolerances = [asked.tolerance for asked in now]
    seconds = INLINE_SECONDS + sum(asked.seconds for asked in now)
    work = functools.partial(price_together, contracts, tolerances, now[0].greeks)
    try:
        # What was interrupted may be less exact than an undisturbed answer, and is not given.
        return inline(work, processor_limit(seconds)) or [None] * len(now)
    except Exception:  # one of them is to blame: each is asked again, alone
        return [None] * len(now)
