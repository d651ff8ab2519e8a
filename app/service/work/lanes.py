"""The order in which questions are priced: cheap ones at once, expensive ones by few threads, in turn by client."""

import asyncio
import contextlib
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect

from app.service.errors import ClientLimitError, DeadlineError, OverloadedError
from app.service.work.cost_model import CHEAP_SECONDS
from app.service.work.work_budgets import WorkBudgets
from app.settings import Settings

Answer = TypeVar("Answer")
Interrupt = Callable[[], bool]
# Processor time on the event loop after which a question that was thought cheap is an expensive one; chosen.
INLINE_SECONDS = 2.5 * CHEAP_SECONDS
NICENESS = 10  # of the threads for expensive questions: the event loop goes first; chosen
LATE_SHARE = 0.03  # share of the deadline after which work that does not end is no longer waited for; chosen
ENDING_SECONDS = 5.0  # how long work that was told to end is waited for when all ends; chosen


class Interruption:
    """Tells work when to end: at its deadline, or when no client waits for it any more."""

    def __init__(self, expires: float) -> None:
        self.expires = expires

    def __call__(self) -> bool:
        """Return whether the work shall end."""
        return time.monotonic() > self.expires

    def end_by(self, when: float) -> None:
        """Bring the end forward to this reading of the monotonic clock."""
        self.expires = min(self.expires, when)


def processor_limit(seconds: float) -> Interrupt:
    """Return the interrupt that comes when this thread has worked so long, however busy the machine is."""
    end = time.thread_time() + seconds
    return lambda: time.thread_time() > end


def inline(work: Callable[[Interrupt], Answer], limit: Interrupt | None = None) -> Answer | None:
    """Return what becomes of work that is thought cheap, done at once; None where it turns out not to be.

    Parameters
    ----------
    limit : callable, optional
        Tells when to give it up; after `INLINE_SECONDS` of this thread unless given.
    """
    limit, interrupted = limit or processor_limit(INLINE_SECONDS), False

    def interrupt() -> bool:
        nonlocal interrupted
        interrupted = interrupted or limit()
        return interrupted

    try:
        answer = work(interrupt)
    except Exception:
        if interrupted:
            return None
        raise
    return None if interrupted else answer


@dataclass(slots=True, eq=False)
class Place:
    """The place of a request in the expensive lane until it is answered.

    Parameters
    ----------
    client : str
        Whose request it is.
    expires : float
        Reading of the monotonic clock by which its work ends.
    late_seconds : float
        How long work that does not end then is waited for.
    seconds_per_minute : float or None
        What its client may take of the threads.
    waited : float
        Seconds that it has waited for a thread so far.
    """

    client: str
    expires: float
    late_seconds: float
    seconds_per_minute: float | None = None
    waited: float = 0.0

    def has_time(self) -> bool:
        """Tell whether the time by which its work ends is still to come."""
        return time.monotonic() < self.expires


@dataclass(eq=False)
class _Job:
    work: Callable[[Interrupt], Any]
    place: Place
    interruption: Interruption
    answer: asyncio.Future[Any] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    asked: float = field(default_factory=time.monotonic)
    in_thread: Future[Any] | None = None  # None before it has begun
    worked: float = 0.0  # seconds of a processor

    def __call__(self) -> Any:
        """Do the work, in a thread."""
        begun = time.thread_time()
        try:
            return self.work(self.interruption)
        finally:
            self.worked = time.thread_time() - begun
            # An error holds this frame, and the answer the error: without this a body would stay until garbage is
            # collected, which counts objects and not their size.
            del self

    @property
    def begun(self) -> bool:
        """Whether a thread has been given it."""
        return self.in_thread is not None

    def waits_no_more(self) -> None:
        """Add the time since it was asked to that which its place has waited."""
        self.place.waited += time.monotonic() - self.asked

    @property
    def seconds_left(self) -> float:
        """The seconds until the work is interrupted."""
        return max(0.0, self.interruption.expires - time.monotonic())

    @property
    def seconds_over(self) -> float:
        """The seconds since then."""
        return max(0.0, time.monotonic() - self.interruption.expires)


class ExpensiveLane:
    """`slots` threads; the next question is that of the client with the fewest in work, the longest waiting first.

    A client has at most `client_queue` requests here, and all slots but one, so that another finds one free. Only
    the event loop's thread may call the methods.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._executor = ThreadPoolExecutor(settings.slots, "expensive", initializer=_give_way)
        self._free = settings.slots
        self._share = max(1, settings.slots - 1)
        self._waiting: dict[str, deque[_Job]] = {}
        self._running: Counter[str] = Counter()
        self._places: Counter[str] = Counter()
        self._jobs: set[_Job] = set()
        self._budgets = WorkBudgets()
        self._ends_by = float("inf")

    def enter(
        self,
        client: str,
        deadline_seconds: float | None = None,
        *,
        most: int | None = None,
        seconds_per_minute: float | None = None,
    ) -> Place:
        """Return a place for a request of a client, to be left again.

        Parameters
        ----------
        deadline_seconds : float, optional
            Seconds from now until its work ends; those of the settings unless given.
        most : int, optional
            Requests that the client may have here; that of the settings unless given.
        seconds_per_minute : float, optional
            Seconds that its work may take of the threads in a minute; no limit unless given.

        Raises
        ------
        ClientLimitError, OverloadedError
            The client, or all together, have as many requests here as they may.
        """
        if self._ends_by < time.monotonic():
            raise OverloadedError("the service is shutting down")
        most = most or self._settings.client_queue
        if self._places[client] >= most:
            raise ClientLimitError(f"this client has {most} expensive questions waiting or in work already")
        if self._places.total() >= self._settings.slots + self._settings.queue:
            raise OverloadedError("every thread for expensive questions is busy and the queue is full")
        if seconds_per_minute is not None:
            self._budgets.check(client, seconds_per_minute)
        self._places[client] += 1
        seconds = self._settings.deadline_seconds if deadline_seconds is None else deadline_seconds
        return Place(client, time.monotonic() + seconds, LATE_SHARE * seconds, seconds_per_minute)

    def leave(self, place: Place) -> None:
        """Give a place back."""
        _count_down(self._places, place.client)

    async def run(
        self, work: Callable[[Interrupt], Answer], place: Place, gone: Coroutine[Any, Any, None]
    ) -> Answer:
        """Do `work` in a thread; it is given the interrupt that tells when to end.

        Parameters
        ----------
        gone : coroutine
            Ends when the client has gone; so does the work then.

        Raises
        ------
        OverloadedError
            The service is shutting down.
        DeadlineError
            The deadline passed without an answer.
        ClientDisconnect
            The client has gone.
        """
        left = asyncio.ensure_future(gone)
        job = self._put(work, place)
        try:
            waited_for: set[asyncio.Future[Any]] = {job.answer, left}
            await asyncio.wait(waited_for, timeout=job.seconds_left, return_when="FIRST_COMPLETED")
            if job.begun and not job.answer.done() and not left.done():
                late = max(0.0, place.late_seconds - job.seconds_over)
                await asyncio.wait(waited_for, timeout=late, return_when="FIRST_COMPLETED")
            if job.answer.done():
                return job.answer.result()  # type: ignore[no-any-return]
            if left.done():
                raise ClientDisconnect
            raise DeadlineError("no thread for expensive questions became free, or none was done, in time")
        finally:
            left.cancel()
            self._give_up(job)

    def end_by(self, when: float) -> None:
        """End all work, present and future, by this reading of the monotonic clock."""
        self._ends_by = when
        for job in self._jobs:
            job.interruption.end_by(when)

    def close(self) -> bool:
        """Interrupt what still runs, wait for it, but not for ever, and tell whether all of it has ended."""
        self.end_by(-float("inf"))
        self._executor.shutdown(wait=False, cancel_futures=True)
        begun = [job.in_thread for job in self._jobs if job.in_thread is not None]
        return not wait(begun, ENDING_SECONDS).not_done

    @property
    def in_work(self) -> int:
        """The number of threads at work."""
        return self._running.total()

    @property
    def waiting(self) -> int:
        """The number of questions that wait for a thread."""
        return sum(map(len, self._waiting.values()))

    def _put(self, work: Callable[[Interrupt], Any], place: Place) -> _Job:
        job = _Job(work, place, Interruption(min(place.expires, self._ends_by)))
        self._jobs.add(job)
        self._waiting.setdefault(place.client, deque()).append(job)
        self._start()
        return job

    def _has_room(self, client: str) -> bool:
        return self._free > 0 and self._running[client] < self._share

    def _start(self) -> None:
        """Begin what may begin."""
        while clients := [client for client in self._waiting if self._has_room(client)]:
            client = min(clients, key=self._running.__getitem__)
            line = self._waiting.pop(client)
            job = line.popleft()
            if line:
                self._waiting[client] = line  # behind the other clients
            self._free -= 1
            self._running[client] += 1
            job.in_thread = self._executor.submit(job)
            job.waits_no_more()
            done = asyncio.wrap_future(job.in_thread)
            done.add_done_callback(lambda done, job=job: self._done(job, done))  # type: ignore[misc]

    def _done(self, job: _Job, done: asyncio.Future[Any]) -> None:
        """Free the slot: when the thread is done, not when the client has gone."""
        self._free += 1
        place = job.place
        _count_down(self._running, place.client)
        self._jobs.discard(job)
        if place.seconds_per_minute is not None:
            self._budgets.spend(place.client, place.seconds_per_minute, job.worked)
        error = None if done.cancelled() else done.exception()
        if not job.answer.done():
            if done.cancelled():
                job.answer.set_exception(OverloadedError("the service is shutting down"))
            elif error is not None:
                job.answer.set_exception(error)
            else:
                job.answer.set_result(done.result())
        self._start()

    def _give_up(self, job: _Job) -> None:
        """Nobody waits for this answer any more."""
        job.interruption.end_by(-float("inf"))
        job.answer.cancel()
        if not job.begun:
            job.waits_no_more()
            line = self._waiting[job.place.client]
            line.remove(job)
            if not line:
                del self._waiting[job.place.client]
            self._jobs.discard(job)


def _count_down(counter: Counter[str], client: str) -> None:
    counter[client] -= 1
    if not counter[client]:
        del counter[client]


def _give_way() -> None:
    """Let the event loop's thread go first, where the system has priorities of threads."""
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
