import asyncio
import os
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.requests import ClientDisconnect

from app.main import create_app
from app.service.errors import ClientLimitError, DeadlineError, OverloadedError
from app.service.work.lanes import ExpensiveLane, Interrupt, inline
from app.settings import Settings
from pricing_core.american import price

EXPENSIVE = {"tolerance": 1e-8, "greeks": "extended"}


async def run(
    lane: ExpensiveLane, work: Callable[[Interrupt], Any], client: str, gone: Coroutine[Any, Any, None]
) -> Any:
    """Enter, work and leave as a request does."""
    try:
        place = lane.enter(client)
    except BaseException:
        gone.close()
        raise
    try:
        return await lane.run(work, place, gone)
    finally:
        lane.leave(place)


async def never() -> None:
    """Wait as for a client that stays."""
    await asyncio.Event().wait()


def in_a_lane(scenario: Callable[[ExpensiveLane], Awaitable[Any]], **settings: Any) -> Any:
    async def run() -> Any:
        lane = ExpensiveLane(Settings(**settings))
        try:
            return await scenario(lane)
        finally:
            lane.close()

    return asyncio.run(run())


def until_interrupted(interrupt: Interrupt) -> str:
    until = time.monotonic() + 10.0
    while not interrupt() and time.monotonic() < until:
        time.sleep(0.005)
    return "interrupted" if interrupt() else "not interrupted"


def test_questions_beyond_slots_and_queue_are_refused_and_the_others_answered() -> None:
    async def scenario(lane: ExpensiveLane) -> list[str]:
        gate = threading.Event()

        def work(_: Interrupt) -> str:
            gate.wait(10.0)
            return "done"

        admitted = [asyncio.create_task(run(lane, work, name, never())) for name in "ab"]
        await asyncio.sleep(0.05)
        with pytest.raises(OverloadedError):
            await run(lane, work, "c", never())
        gate.set()
        answers = await asyncio.gather(*admitted)
        return [*answers, await run(lane, work, "c", never())]

    assert in_a_lane(scenario, slots=1, queue=1) == ["done", "done", "done"]


def test_a_client_at_its_own_limit_is_refused_and_others_are_not() -> None:
    async def scenario(lane: ExpensiveLane) -> str:
        gate = threading.Event()
        greedy = [
            asyncio.create_task(run(lane, lambda _: gate.wait(10.0), "greedy", never())) for _ in range(3)
        ]
        await asyncio.sleep(0.05)
        with pytest.raises(ClientLimitError):
            await run(lane, lambda _: None, "greedy", never())
        answer = await run(lane, lambda _: "at once", "other", never())  # one slot is never one client's
        gate.set()
        await asyncio.gather(*greedy)
        return answer

    assert in_a_lane(scenario, slots=2, queue=8, client_queue=3) == "at once"


def test_clients_take_turns_however_many_questions_each_has() -> None:
    begun: list[str] = []

    async def scenario(lane: ExpensiveLane) -> None:
        def work(name: str) -> Callable[[Interrupt], None]:
            return lambda _: (begun.append(name), time.sleep(0.01))[1]

        names = ["a"] * 5 + ["b"] * 2 + ["c"]
        await asyncio.gather(*(run(lane, work(name), name, never()) for name in names))

    in_a_lane(scenario, slots=1, client_queue=5)
    assert begun == list("aabcabaa")


def test_the_interrupt_tells_when_the_deadline_has_passed() -> None:
    async def scenario(lane: ExpensiveLane) -> tuple[str, float]:
        asked = time.monotonic()
        return await run(lane, until_interrupted, "a", never()), time.monotonic() - asked

    answer, seconds = in_a_lane(scenario, slots=1, deadline_seconds=0.5)
    assert answer == "interrupted"
    assert 0.5 <= seconds < 0.7


def test_work_that_does_not_end_is_not_waited_for() -> None:
    async def scenario(lane: ExpensiveLane) -> float:
        gate, asked = threading.Event(), time.monotonic()
        with pytest.raises(DeadlineError):
            await run(lane, lambda _: gate.wait(10.0), "a", never())
        gate.set()
        return time.monotonic() - asked

    assert in_a_lane(scenario, slots=1, deadline_seconds=0.5) < 0.7


def test_a_request_is_waited_for_no_longer_by_having_several_pieces_of_work() -> None:
    async def scenario(lane: ExpensiveLane) -> None:
        place = lane.enter("a", 1_000.0)  # 30 s of waiting for what does not end
        place.expires = time.monotonic() - 60.0
        assert not place.has_time()
        stop = threading.Event()
        try:
            with pytest.raises(DeadlineError):
                await asyncio.wait_for(lane.run(lambda _: stop.wait(60.0), place, never()), 10.0)
        finally:
            stop.set()

    in_a_lane(scenario, slots=2)


def test_work_still_waiting_at_its_deadline_is_refused_at_once_and_never_begun() -> None:
    begun: list[str] = []

    async def scenario(lane: ExpensiveLane) -> float:
        gate = threading.Event()
        busy = asyncio.create_task(run(lane, lambda _: gate.wait(10.0), "a", never()))
        await asyncio.sleep(0.05)
        asked = time.monotonic()
        waiting = [run(lane, lambda _: begun.append("late"), "b", never()) for _ in range(3)]
        answers = await asyncio.gather(*waiting, return_exceptions=True)
        waited = time.monotonic() - asked
        assert [type(answer) for answer in answers] == [DeadlineError] * 3
        gate.set()
        await asyncio.gather(busy, return_exceptions=True)
        await asyncio.sleep(0.05)
        await run(lane, lambda _: begun.append("in time"), "b", never())
        return waited

    assert in_a_lane(scenario, slots=1, deadline_seconds=0.2) < 5.0  # the thread was busy for longer
    assert begun == ["in time"]


def test_a_client_that_goes_ends_its_work_and_frees_its_slot_and_its_place() -> None:
    async def scenario(lane: ExpensiveLane) -> tuple[str, list[str]]:
        ends: list[str] = []
        leaves = asyncio.Event()

        async def gone() -> None:
            await leaves.wait()

        def work(interrupt: Interrupt) -> None:
            ends.append(until_interrupted(interrupt))

        tasks = [asyncio.create_task(run(lane, work, "a", gone())) for _ in range(3)]
        await asyncio.sleep(0.05)
        assert (lane.in_work, lane.waiting) == (1, 2)
        leaves.set()
        for answer in await asyncio.gather(*tasks, return_exceptions=True):
            assert isinstance(answer, ClientDisconnect)
        answer = await run(lane, lambda _: "free again", "b", never())
        assert (lane.in_work, lane.waiting) == (0, 0)
        return answer, ends

    assert in_a_lane(scenario, slots=1) == ("free again", ["interrupted"])


def test_a_question_that_is_given_up_keeps_its_slot_until_its_thread_is_done() -> None:
    async def scenario(lane: ExpensiveLane) -> None:
        gate = threading.Event()
        task = asyncio.create_task(run(lane, lambda _: gate.wait(10.0), "a", never()))
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        next_one = asyncio.create_task(run(lane, lambda _: None, "b", never()))
        await asyncio.sleep(0.1)
        assert (lane.in_work, lane.waiting) == (1, 1)
        gate.set()
        await next_one

    in_a_lane(scenario, slots=1, queue=0)


def test_an_end_brought_forward_holds_for_what_runs_and_what_comes() -> None:
    gate = threading.Event()

    def work(interrupt: Interrupt) -> str:
        answer = until_interrupted(interrupt)
        gate.wait(10.0)
        return answer

    async def scenario(lane: ExpensiveLane) -> str:
        task = asyncio.create_task(run(lane, work, "a", never()))
        await asyncio.sleep(0.05)
        lane.end_by(time.monotonic() + 0.1)
        with pytest.raises(DeadlineError):  # the only thread is not free before
            await run(lane, until_interrupted, "a", never())
        gate.set()
        answer = await task
        with pytest.raises(OverloadedError):
            await run(lane, until_interrupted, "a", never())
        return answer

    assert in_a_lane(scenario, slots=1) == "interrupted"


def test_an_error_of_the_work_is_the_answer() -> None:
    async def scenario(lane: ExpensiveLane) -> None:
        with pytest.raises(ZeroDivisionError):
            await run(lane, lambda _: 1 // 0, "a", never())
        await run(lane, lambda _: None, "a", never())

    in_a_lane(scenario, slots=1)


def test_work_that_is_not_cheap_after_all_is_given_up_and_nothing_else_is() -> None:
    def busy(interrupt: Interrupt) -> str:
        until = time.monotonic() + 10.0
        while not interrupt() and time.monotonic() < until:
            pass
        return "interrupted"

    def failing(interrupt: Interrupt) -> None:
        raise ValueError(busy(interrupt))

    assert inline(busy) is None
    assert inline(failing) is None
    assert inline(lambda interrupt: interrupt()) is False
    assert inline(lambda interrupt: (time.sleep(0.05), interrupt())[1]) is False  # others had the processor
    with pytest.raises(ZeroDivisionError):
        inline(lambda _: 1 // 0)


@pytest.mark.skipif(not hasattr(os, "setpriority"), reason="no priorities of threads here")
def test_the_threads_give_way() -> None:
    async def scenario(lane: ExpensiveLane) -> int:
        return await run(
            lane, lambda _: os.getpriority(os.PRIO_PROCESS, threading.get_native_id()), "a", never()
        )

    assert in_a_lane(scenario) > os.getpriority(os.PRIO_PROCESS, 0) or os.getpriority(os.PRIO_PROCESS, 0) > 9


def test_an_overloaded_service_answers_503_and_cheap_questions_all_the_same(
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, begun = threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        begun.set()
        gate.wait(30.0)
        return price(*arguments, **options)

    monkeypatch.setattr("app.service.routes.price.price", slow)
    settings = Settings(slots=1, queue=0, client_queue=2, retry_after_seconds=3)
    with TestClient(create_app(settings)) as client, ThreadPoolExecutor(1) as other:
        first = other.submit(client.post, "/v1/price", json=question | EXPENSIVE)
        assert begun.wait(10.0)
        refused = client.post("/v1/price", json=question | EXPENSIVE)
        cheap = client.post("/v1/price", json=question | {"exercise": "european"})
        alive = client.get("/livez")
        gate.set()
        assert first.result().status_code == 200
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "3")
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["type"] == "/docs#overloaded"
    assert (alive.status_code, cheap.status_code) == (200, 200)


def test_a_question_that_is_dearer_than_it_was_thought_is_not_refused_for_what_its_client_does(
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, begun = threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        if options["tolerance"] == EXPENSIVE["tolerance"]:
            begun.set()
            gate.wait(30.0)
        return price(*arguments, **options)

    async def given_up(*_: Any) -> None:
        return None

    monkeypatch.setattr("app.service.routes.price.price", slow)
    monkeypatch.setattr("app.service.work.cheap_lane.CheapLane.price", given_up)
    with TestClient(create_app(Settings(slots=2, client_queue=1))) as client, ThreadPoolExecutor(1) as other:
        first = other.submit(client.post, "/v1/price", json=question | EXPENSIVE)
        assert begun.wait(10.0)
        assert client.post("/v1/price", json=question | EXPENSIVE).status_code == 429
        cheap = client.post("/v1/price", json=question)
        gate.set()
        assert first.result().status_code == 200
    assert cheap.status_code == 200


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary"])
def test_a_deadline_ends_the_engine_s_work_with_a_503(question: dict[str, Any], address: str) -> None:
    dividends = [{"time": 0.5, "amount": 1.0}]
    general = {"rate": -0.01, "dividend_yield": -0.03, "tolerance": 1e-8, "cash_dividends": dividends}
    with TestClient(create_app(Settings(deadline_seconds=1e-6))) as client:
        answer = client.post(address, json=question | general)
    _assert_deadline(answer)


def test_a_deadline_ends_the_search_for_a_volatility_with_a_503() -> None:
    contract = {
        "option_type": "call",
        "spot": 60.0,
        "strike": 60.0,
        "expiry": 1.0,
        "rate": {"times": [0.25], "values": [0.02]},
        "cash_dividends": [{"time": (day + 1) / 367, "amount": 0.01} for day in range(366)],
        "option_price": 7.0,
        "tolerance": 1e-8,
    }
    with TestClient(create_app(Settings(deadline_seconds=0.05))) as client:
        _assert_deadline(client.post("/v1/implied-volatility", json=contract))


def _assert_deadline(answer: Any) -> None:
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert answer.json()["type"] == "/docs#deadline"


def test_work_that_never_ends_does_not_keep_the_lane_from_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.service.work.lanes.ENDING_SECONDS", 0.2)

    async def scenario() -> bool:
        lane, gate, begun = ExpensiveLane(Settings(slots=1)), threading.Event(), threading.Event()

        def stuck(_: Interrupt) -> bool:
            begun.set()
            return gate.wait(60.0)

        asked = asyncio.ensure_future(run(lane, stuck, "a", never()))
        await asyncio.to_thread(begun.wait, 60.0)
        ended = lane.close()
        gate.set()
        await asyncio.gather(asked, return_exceptions=True)
        assert lane.close()
        return ended

    assert not asyncio.run(scenario())
