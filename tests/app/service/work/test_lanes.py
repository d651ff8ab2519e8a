import asyncio
import json
import logging
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
from app.service.work.admission import LONGEST_CHEAP_BODY
from app.service.work.lanes import ExpensiveLane, Interrupt, inline
from app.service.work.route_limits import for_batch
from app.settings import Settings
from pricing_core.american import price
from tests.problems.eventually import PATIENCE

ENDLESS = 1e6  # seconds of a deadline that only something else comes before
EXPENSIVE = {"tolerance": 1e-8, "greeks": "extended"}


async def run(
    lane: ExpensiveLane,
    work: Callable[[Interrupt], Any],
    client: str,
    gone: Coroutine[Any, Any, None],
    seconds: float = ENDLESS,
) -> Any:
    """Enter, work and leave as a request does."""
    try:
        place = lane.enter(client, seconds)
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
            return await asyncio.wait_for(scenario(lane), PATIENCE)
        finally:
            lane.close()

    return asyncio.run(run())


async def are(lane: ExpensiveLane, in_work: int, waiting: int) -> None:
    """Wait until so many questions are in work, and so many wait."""
    while (lane.in_work, lane.waiting) != (in_work, waiting):
        await asyncio.sleep(0.001)


def until_interrupted(interrupt: Interrupt) -> str:
    while not interrupt():
        time.sleep(0.001)
    return "interrupted"


def test_questions_beyond_slots_and_queue_are_refused_and_the_others_answered() -> None:
    async def scenario(lane: ExpensiveLane) -> list[str]:
        gate = threading.Event()

        def work(_: Interrupt) -> str:
            gate.wait(PATIENCE)
            return "done"

        admitted = [asyncio.create_task(run(lane, work, name, never())) for name in "ab"]
        await are(lane, in_work=1, waiting=1)
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
            asyncio.create_task(run(lane, lambda _: gate.wait(PATIENCE), "greedy", never())) for _ in range(3)
        ]
        await are(lane, in_work=1, waiting=2)
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
        gate = threading.Event()

        def work(name: str) -> Callable[[Interrupt], None]:
            return lambda _: (begun.append(name), gate.wait(PATIENCE))[0]

        names = ["a"] * 5 + ["b"] * 2 + ["c"]
        asked = [asyncio.create_task(run(lane, work(name), name, never())) for name in names]
        await are(lane, in_work=1, waiting=7)
        gate.set()
        await asyncio.gather(*asked)

    in_a_lane(scenario, slots=1, client_queue=5)
    assert begun == list("aabcabaa")


def test_a_free_thread_goes_to_the_client_with_the_fewest_in_work() -> None:
    begun: list[str] = []

    async def scenario(lane: ExpensiveLane) -> None:
        gates = {name: threading.Event() for name in ("first", "others")}

        def work(name: str, gate: str) -> Callable[[Interrupt], None]:
            return lambda _: (begun.append(name), gates[gate].wait(PATIENCE))[0]

        asked = [("x", "first"), ("a", "others"), ("a", "others"), ("y", "others")]  # every thread is busy
        asked += [("a", "others"), ("b", "others")]  # these wait, b longer behind
        tasks = [asyncio.create_task(run(lane, work(*one), one[0], never())) for one in asked]
        await are(lane, in_work=4, waiting=2)
        gates["first"].set()
        await are(lane, in_work=4, waiting=1)
        gates["others"].set()
        await asyncio.gather(*tasks)

    in_a_lane(scenario, slots=4)
    assert sorted(begun[:4]) == ["a", "a", "x", "y"]
    assert begun[4:] == ["b", "a"]


def test_the_interrupt_tells_when_the_deadline_has_passed() -> None:
    async def scenario(lane: ExpensiveLane) -> tuple[str, float]:
        asked = time.monotonic()
        place = lane.enter("a", 0.1)
        place.late_seconds = PATIENCE  # however late its thread is told
        return await lane.run(until_interrupted, place, never()), time.monotonic() - asked

    answer, seconds = in_a_lane(scenario, slots=1)
    assert answer == "interrupted"
    assert seconds >= 0.1


def test_work_that_does_not_end_is_not_waited_for() -> None:
    async def scenario(lane: ExpensiveLane) -> None:
        gate = threading.Event()
        with pytest.raises(DeadlineError):
            await run(lane, lambda _: gate.wait(PATIENCE), "a", never(), seconds=0.1)
        gate.set()

    in_a_lane(scenario, slots=1)


def test_a_request_is_waited_for_no_longer_by_having_several_pieces_of_work() -> None:
    async def scenario(lane: ExpensiveLane) -> None:
        place = lane.enter("a", ENDLESS)  # 3 % of that is how long what does not end is waited for
        place.expires = time.monotonic() - ENDLESS
        assert not place.has_time()
        stop = threading.Event()
        try:
            with pytest.raises(DeadlineError):
                await lane.run(lambda _: stop.wait(PATIENCE), place, never())
        finally:
            stop.set()

    in_a_lane(scenario, slots=2)


def test_work_still_waiting_at_its_deadline_is_refused_at_once_and_never_begun() -> None:
    begun: list[str] = []

    async def scenario(lane: ExpensiveLane) -> None:
        gate = threading.Event()
        busy = asyncio.create_task(run(lane, lambda _: gate.wait(PATIENCE), "a", never()))
        await are(lane, in_work=1, waiting=0)
        waiting = [run(lane, lambda _: begun.append("late"), "b", never(), seconds=0.1) for _ in range(3)]
        answers = await asyncio.gather(*waiting, return_exceptions=True)
        assert [type(answer) for answer in answers] == [DeadlineError] * 3
        gate.set()  # the thread was busy for longer
        await busy
        await run(lane, lambda _: begun.append("in time"), "b", never())

    in_a_lane(scenario, slots=1)
    assert begun == ["in time"]


def test_a_client_that_goes_ends_its_work_and_frees_its_slot_and_its_place() -> None:
    async def scenario(lane: ExpensiveLane) -> tuple[str, list[str]]:
        ends: list[str] = []
        begun, leaves = threading.Event(), asyncio.Event()

        async def gone() -> None:
            await leaves.wait()

        def work(interrupt: Interrupt) -> None:
            begun.set()
            ends.append(until_interrupted(interrupt))

        tasks = [asyncio.create_task(run(lane, work, "a", gone())) for _ in range(3)]
        await are(lane, in_work=1, waiting=2)
        await asyncio.to_thread(begun.wait, PATIENCE)
        leaves.set()
        for answer in await asyncio.gather(*tasks, return_exceptions=True):
            assert isinstance(answer, ClientDisconnect)
        answer = await run(lane, lambda _: "free again", "b", never())
        assert (lane.in_work, lane.waiting) == (0, 0)
        return answer, ends

    assert in_a_lane(scenario, slots=1) == ("free again", ["interrupted"])


def test_a_question_that_is_given_up_keeps_its_slot_until_its_thread_is_done() -> None:
    order: list[str] = []

    async def scenario(lane: ExpensiveLane) -> None:
        gate, begun = threading.Event(), threading.Event()

        def work(_: Interrupt) -> None:
            begun.set()
            gate.wait(PATIENCE)
            order.append("given up")

        task = asyncio.create_task(run(lane, work, "a", never()))
        await asyncio.to_thread(begun.wait, PATIENCE)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        next_one = asyncio.create_task(run(lane, lambda _: order.append("next"), "b", never()))
        await asyncio.sleep(0.0)
        assert (lane.in_work, lane.waiting) == (1, 1)
        gate.set()
        await next_one

    in_a_lane(scenario, slots=1, queue=0)
    assert order == ["given up", "next"]


def test_an_end_brought_forward_holds_for_what_runs_and_what_comes() -> None:
    gate = threading.Event()

    def work(interrupt: Interrupt) -> str:
        answer = until_interrupted(interrupt)
        gate.wait(PATIENCE)
        return answer

    async def scenario(lane: ExpensiveLane) -> str:
        task = asyncio.create_task(run(lane, work, "a", never()))
        await are(lane, in_work=1, waiting=0)
        place = lane.enter("a", ENDLESS)
        lane.end_by(time.monotonic() + 0.1)
        with pytest.raises(DeadlineError):  # the only thread is not free before
            await lane.run(until_interrupted, place, never())
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
        end = time.monotonic() + PATIENCE
        while not interrupt():
            assert time.monotonic() < end
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
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch, unhurried: None
) -> None:
    gate, begun = threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        begun.set()
        gate.wait(PATIENCE)
        return price(*arguments, **options)

    monkeypatch.setattr("app.service.routes.price.price", slow)
    settings = Settings(slots=1, queue=0, client_queue=2, retry_after_seconds=3, deadline_seconds=3_600.0)
    with TestClient(create_app(settings)) as client, ThreadPoolExecutor(1) as other:
        first = other.submit(client.post, "/v1/price", json=question | EXPENSIVE)
        assert begun.wait(PATIENCE)
        refused = client.post("/v1/price", json=question | EXPENSIVE)
        cheap = client.post("/v1/price", json=question | {"exercise": "european"})
        alive = client.get("/livez")
        gate.set()
        assert first.result().status_code == 200
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "3")
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["type"] == "/docs#overloaded"
    assert (alive.status_code, cheap.status_code) == (200, 200)


def test_a_long_body_is_an_expensive_question_and_every_place_is_given_back(
    question: dict[str, Any], unhurried: None, caplog: pytest.LogCaptureFixture
) -> None:
    texts = [json.dumps(question), json.dumps(question) + LONGEST_CHEAP_BODY * " "]
    settings = Settings(slots=2, deadline_seconds=3_600.0)
    with caplog.at_level(logging.INFO, logger="pricing.requests"), TestClient(create_app(settings)) as client:
        for text in texts:
            headers = {"Content-Type": "application/json"}
            assert client.post("/v1/price", content=text, headers=headers).status_code == 200
        assert not client.app.state.expensive_lane._places  # type: ignore[attr-defined]
    lines = [record.fields for record in caplog.records if record.name == "pricing.requests"]  # type: ignore[attr-defined]
    assert ["waited" in line for line in lines] == [False, True]


def test_the_rows_of_a_batch_end_while_there_is_time_to_write_the_answer() -> None:
    limits = for_batch(Settings(batch_deadline_seconds=100.0))
    assert (limits.body_seconds, limits.deadline_seconds) == (100.0, 95.0)


def test_a_question_that_is_dearer_than_it_was_thought_is_not_refused_for_what_its_client_does(
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, begun = threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        if options["tolerance"] == EXPENSIVE["tolerance"]:
            begun.set()
            gate.wait(PATIENCE)
        return price(*arguments, **options)

    async def given_up(*_: Any) -> None:
        return None

    monkeypatch.setattr("app.service.routes.price.price", slow)
    monkeypatch.setattr("app.service.work.cheap_lane.CheapLane.price", given_up)
    settings = Settings(slots=2, client_queue=1, deadline_seconds=3_600.0)
    with TestClient(create_app(settings)) as client, ThreadPoolExecutor(1) as other:
        first = other.submit(client.post, "/v1/price", json=question | EXPENSIVE)
        assert begun.wait(PATIENCE)
        assert client.post("/v1/price", json=question | EXPENSIVE).status_code == 429
        cheap = client.post("/v1/price", json=question)
        gate.set()
        assert first.result().status_code == 200
    assert cheap.status_code == 200


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary"])
def test_a_deadline_ends_the_engine_s_work_with_a_503(
    question: dict[str, Any], address: str, waited_for: None
) -> None:
    dividends = [{"time": 0.5, "amount": 1.0}]
    general = {"rate": -0.01, "dividend_yield": -0.03, "tolerance": 1e-8, "cash_dividends": dividends}
    with TestClient(create_app(Settings(deadline_seconds=1e-6))) as client:
        answer = client.post(address, json=question | general)
    _assert_deadline(answer)


def test_a_deadline_ends_the_search_for_a_volatility_with_a_503(waited_for: None) -> None:
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
    with TestClient(create_app(Settings(deadline_seconds=1e-6))) as client:
        _assert_deadline(client.post("/v1/implied-volatility", json=contract))


def _assert_deadline(answer: Any) -> None:
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert answer.json()["type"] == "/docs#deadline"
    assert "a wider tolerance is faster" in answer.json()["detail"]  # as the route says, not the lane


def test_work_that_never_ends_does_not_keep_the_lane_from_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.service.work.lanes.ENDING_SECONDS", 0.2)

    async def scenario() -> bool:
        lane = ExpensiveLane(Settings(slots=1, deadline_seconds=3_600.0))
        gate, begun = threading.Event(), threading.Event()

        def stuck(_: Interrupt) -> bool:
            begun.set()
            return gate.wait(PATIENCE)

        asked = asyncio.ensure_future(run(lane, stuck, "a", never()))
        await asyncio.to_thread(begun.wait, PATIENCE)
        ended = lane.close()
        gate.set()
        await asyncio.gather(asked, return_exceptions=True)
        assert lane.close()
        return ended

    assert not asyncio.run(scenario())
