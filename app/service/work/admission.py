"""The admission of questions: a cheap one is answered at once, any other one in the expensive lane."""

from collections.abc import Callable
from typing import TypeVar

from fastapi import Request

from app.service.api_keys import KeyLimits
from app.service.clients import client_of
from app.service.metrics import Metrics
from app.service.request_record import record_of
from app.service.work.cost_model import CHEAP_SECONDS
from app.service.work.lanes import ExpensiveLane, Interrupt, Place, inline
from app.service.work.route_limits import RouteLimits

Answer = TypeVar("Answer")

NO_LIMITS = KeyLimits()
LONGEST_CHEAP_BODY = 1_024  # bytes: dividends in pairs take 1 ms to read; measured


async def read_body(request: Request, body: bytes, parse: Callable[[bytes], Answer]) -> Answer:
    """Return a parsed body; a long one is an expensive question already, whatever it asks.

    Raises
    ------
    ClientLimitError, OverloadedError, DeadlineError, ClientDisconnect
        As `ExpensiveLane.enter` and `run`.
    """
    request.state.is_long = len(body) > LONGEST_CHEAP_BODY
    if not request.state.is_long:
        return parse(body)
    return await answer_expensive(request, lambda _: parse(body))


async def answer(
    request: Request, work: Callable[[Interrupt], Answer], expected: Callable[[], float]
) -> Answer:
    """Do the work of a question whose body has been read.

    Parameters
    ----------
    work : callable
        Is given the interrupt, which tells it when to end; may be called twice.
    expected : callable
        Returns how many seconds it is expected to take.

    Raises
    ------
    ClientLimitError, OverloadedError, DeadlineError, ClientDisconnect
        As `ExpensiveLane.enter` and `run`.
    """
    if is_cheap(request, expected) and (found := inline(work)) is not None:
        return found
    return await answer_expensive(request, work)


def is_cheap(request: Request, expected: Callable[[], float]) -> bool:
    """Tell whether a question whose body has been read is expected to be answered in less than `CHEAP_SECONDS`."""
    if request.state.is_long:
        return False
    cost = record_of(request).cost = expected()
    return cost < CHEAP_SECONDS


async def answer_expensive(request: Request, work: Callable[[Interrupt], Answer]) -> Answer:
    """Do work in a thread for expensive questions; a request keeps its place and deadline until it is answered."""
    return await expensive_lane(request).run(work, expensive_place(request), _disconnected(request))


def expensive_place(request: Request) -> Place:
    """Return the request's place in the expensive lane, taken when it is first asked for.

    Raises
    ------
    ClientLimitError, OverloadedError
        As `ExpensiveLane.enter`.
    """
    lane, state = expensive_lane(request), request.state
    if not hasattr(state, "place"):
        state.place = _enter(request, lane)
    place: Place = state.place
    return place


def _enter(request: Request, lane: ExpensiveLane) -> Place:
    """Return a place in the lane, which is given back when the request has been answered."""
    limits: KeyLimits = getattr(request.state, "key_limits", NO_LIMITS)
    of_route: RouteLimits = request.state.limits
    cost = record_of(request).cost
    # What was thought cheap has an account of its own: its client's expensive questions never keep it out.
    misjudged = cost is not None and cost < CHEAP_SECONDS
    place = lane.enter(
        client_of(request) + (" (cheap)" if misjudged else ""),
        of_route.deadline_seconds,
        most=limits.client_queue,
        seconds_per_minute=limits.seconds_per_minute,
    )
    metrics: Metrics = request.app.state.metrics
    metrics.expensive.inc()

    def leave() -> None:
        metrics.expensive.dec()
        record_of(request).waited = place.waited
        lane.leave(place)

    request.state.at_end.append(leave)
    return place


def expensive_lane(request: Request) -> ExpensiveLane:
    """Return the application's lane."""
    lane: ExpensiveLane = request.app.state.expensive_lane
    return lane


async def _disconnected(request: Request) -> None:
    """Wait until the client has gone, once its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
