"""The way of a question to its answer: at once where it should be cheap, else by the expensive lane."""

from collections.abc import Callable
from typing import TypeVar

from fastapi import Request

from app.clients import client_of
from app.cost_model import CHEAP_SECONDS
from app.lanes import ExpensiveLane, Interrupt, inline

Answer = TypeVar("Answer")


LONGEST_CHEAP_BODY = 4_096  # bytes: those of a longer one take milliseconds to read; measured


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
    return not request.state.is_long and expected() < CHEAP_SECONDS


async def answer_expensive(request: Request, work: Callable[[Interrupt], Answer]) -> Answer:
    """Do work in a thread for expensive questions; a request keeps its place and deadline until it is answered."""
    lane, state = expensive_lane(request), request.state
    if not hasattr(state, "place"):
        state.place = lane.enter(client_of(request))
        state.at_end.append(lambda: lane.leave(state.place))
    return await lane.run(work, state.place, _disconnected(request))


def expensive_lane(request: Request) -> ExpensiveLane:
    """Return the application's lane."""
    lane: ExpensiveLane = request.app.state.expensive_lane
    return lane


async def _disconnected(request: Request) -> None:
    """Wait until the client has gone, once its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
