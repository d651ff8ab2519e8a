"""The threads that price, behind an admission limit and a deadline; the event loop never waits for them."""

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from app.errors import DeadlineError, OverloadedError
from app.settings import Settings

Answer = TypeVar("Answer")
Interrupt = Callable[[], bool]


class PricingPool:
    """`workers` threads and a queue of bounded length in front of them; beyond it, requests are refused."""

    def __init__(self, settings: Settings) -> None:
        self._deadline_seconds = settings.deadline_seconds
        self._executor = ThreadPoolExecutor(settings.workers, thread_name_prefix="pricing")
        self._admission = threading.BoundedSemaphore(settings.workers + settings.queue)
        self._closing = threading.Event()

    async def run(self, work: Callable[[Interrupt], Answer]) -> Answer:
        """Run `work` in a thread; it is given the interrupt that tells when its deadline has passed.

        Raises
        ------
        OverloadedError
            Every thread is busy and the queue is full.
        DeadlineError
            The deadline passed while the work was waiting; it is not begun.
        """
        if not self._admission.acquire(blocking=False):
            raise OverloadedError("every pricing thread is busy and the queue is full")
        expires = time.monotonic() + self._deadline_seconds
        try:
            future = self._executor.submit(work, lambda: self._closing.is_set() or time.monotonic() > expires)
        except RuntimeError:  # closed
            self._admission.release()
            raise OverloadedError("the service is shutting down") from None
        # When the thread is done, not when the client has gone: the place in the queue is the thread's.
        future.add_done_callback(lambda _: self._admission.release())
        answer = asyncio.wrap_future(future)
        try:
            await asyncio.wait({answer}, timeout=self._deadline_seconds)
        finally:
            never_begun = future.cancel()  # False from the moment a thread takes the work up
        if never_begun:
            raise DeadlineError("no pricing thread became free in time")
        return await answer

    def close(self) -> None:
        """Interrupt what still runs and wait for it."""
        self._closing.set()
        self._executor.shutdown(wait=True, cancel_futures=True)
