"""The way of a question to its answer: at once where it should be cheap, else by the expensive lane."""

from collections.abc import Callable
from typing import TypeVar

from fastapi import Request

from app.clients import client_of
from app.cost_model import CHEAP_SECONDS
from app.lanes import ExpensiveLane, Interrupt, inline

Answer = TypeVar("Answer")


async def answer(request: Request, work: Callable[[Interrupt], Answer], seconds: float) -> Answer:
    """Do the work of a question that is expected to take so many seconds.

    Parameters
    ----------
    work : callable
        Is given the interrupt, which tells it when to end; may be called twice.

    Raises
    ------
    ClientLimitError, OverloadedError, DeadlineError, ClientDisconnect
        As `ExpensiveLane.run`.
    """
    if seconds < CHEAP_SECONDS and (found := inline(work)) is not None:
        return found
    return await answer_expensive(request, work)


async def answer_expensive(request: Request, work: Callable[[Interrupt], Answer]) -> Answer:
    """Do the work of a question in a thread for expensive ones; raises what `ExpensiveLane.run` does."""
    lane: ExpensiveLane = request.app.state.expensive_lane
    return await lane.run(work, client_of(request), _disconnected(request))


async def _disconnected(request: Request) -> None:
    """Wait until the client has gone, once its body has been read."""
    while (await request.receive())["type"] != "http.disconnect":
        pass
