import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.errors import DeadlineError, OverloadedError
from app.main import create_app
from app.pool import Interrupt, PricingPool
from app.settings import Settings
from pricing_core.american import price


def test_requests_beyond_threads_and_queue_are_refused_and_the_others_answered() -> None:
    async def scenario() -> tuple[list[str], bool]:
        pool = PricingPool(Settings(workers=1, queue=1))
        gate = threading.Event()

        def work(_: Interrupt) -> str:
            gate.wait(10.0)
            return "done"

        admitted = [asyncio.create_task(pool.run(work)) for _ in range(2)]
        await asyncio.sleep(0.05)
        with pytest.raises(OverloadedError):
            await pool.run(work)
        gate.set()
        answers = await asyncio.gather(*admitted)
        again = await pool.run(lambda interrupt: interrupt())
        pool.close()
        return answers, again

    assert asyncio.run(scenario()) == (["done", "done"], False)


def test_the_interrupt_tells_when_the_deadline_has_passed() -> None:
    def work(interrupt: Interrupt) -> tuple[bool, bool]:
        at_first = interrupt()
        time.sleep(0.15)
        return at_first, interrupt()

    async def scenario() -> tuple[bool, bool]:
        pool = PricingPool(Settings(workers=1, deadline_seconds=0.1))
        answer = await pool.run(work)
        pool.close()
        return answer

    assert asyncio.run(scenario()) == (False, True)


def test_work_still_waiting_at_its_deadline_is_refused_at_once_and_never_begun() -> None:
    begun: list[str] = []

    async def scenario() -> float:
        pool = PricingPool(Settings(workers=1, queue=4, deadline_seconds=0.2))
        gate = threading.Event()
        busy = asyncio.create_task(pool.run(lambda _: gate.wait(10.0)))
        await asyncio.sleep(0.05)
        asked = time.monotonic()
        waiting = [pool.run(lambda _: begun.append("late")) for _ in range(3)]
        answers = await asyncio.gather(*waiting, return_exceptions=True)
        waited = time.monotonic() - asked
        assert [type(answer) for answer in answers] == [DeadlineError] * 3
        gate.set()
        assert await busy
        await pool.run(lambda _: begun.append("in time"))
        pool.close()
        return waited

    assert asyncio.run(scenario()) < 5.0  # the thread was busy for longer
    assert begun == ["in time"]


def test_a_request_that_is_given_up_keeps_its_place_until_its_thread_is_done() -> None:
    async def scenario() -> None:
        pool = PricingPool(Settings(workers=1, queue=0))
        gate = threading.Event()
        task = asyncio.create_task(pool.run(lambda _: gate.wait(10.0)))
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(OverloadedError):
            await pool.run(lambda _: None)
        gate.set()
        for _ in range(100):
            await asyncio.sleep(0.02)
            try:
                await pool.run(lambda _: None)
                break
            except OverloadedError:
                continue
        else:
            pytest.fail("the place was never given back")
        pool.close()

    asyncio.run(scenario())


def test_closing_interrupts_what_still_runs() -> None:
    def work(interrupt: Interrupt) -> bool:
        until = time.monotonic() + 10.0
        while not interrupt() and time.monotonic() < until:
            time.sleep(0.01)
        return interrupt()

    async def scenario() -> bool:
        pool = PricingPool(Settings(workers=1))
        task = asyncio.create_task(pool.run(work))
        await asyncio.sleep(0.05)
        await asyncio.get_running_loop().run_in_executor(None, pool.close)
        with pytest.raises(OverloadedError):
            await pool.run(work)
        return await task

    assert asyncio.run(scenario()) is True


def test_an_overloaded_service_answers_503_and_stays_alive(
    question: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, begun = threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        begun.set()
        gate.wait(30.0)
        return price(*arguments, **options)

    monkeypatch.setattr("app.routes.price.price", slow)
    with (
        TestClient(create_app(Settings(workers=1, queue=0, retry_after_seconds=3))) as client,
        ThreadPoolExecutor(1) as other,
    ):
        first = other.submit(client.post, "/v1/price", json=question)
        assert begun.wait(10.0)
        refused = client.post("/v1/price", json=question)
        alive = client.get("/livez")
        gate.set()
        assert first.result().status_code == 200
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "3")
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["type"] == "/docs#overloaded"
    assert alive.status_code == 200


@pytest.mark.parametrize("address", ["/v1/price", "/v1/boundary"])
def test_a_deadline_ends_the_engine_s_work_with_a_503(question: dict[str, Any], address: str) -> None:
    with TestClient(create_app(Settings(deadline_seconds=1e-6))) as client:
        answer = client.post(address, json=question | {"tolerance": 1e-8})
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
