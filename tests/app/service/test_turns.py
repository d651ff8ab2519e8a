import asyncio
from itertools import pairwise

from app.service.turns import TURN_SECONDS, Turns
from app.settings import Settings
from tests.app.service.byte_streams import CHUNKED, GET, Reader, connections, feed
from tests.problems.eventually import PATIENCE


class Waiting:
    """A connection that notes when it is read."""

    def __init__(self, read: list[tuple["Waiting", float]]) -> None:
        self._read = read

    def read_again(self) -> None:
        """Note the time."""
        self._read.append((self, asyncio.get_running_loop().time()))


def test_connections_are_read_in_order_one_in_a_turn() -> None:
    read: list[tuple[Waiting, float]] = []

    async def run() -> list[Waiting]:
        turns = Turns()
        waiting = [Waiting(read) for _ in range(30)]
        for connection in waiting:
            turns.enter(connection)
        turns.leave(waiting.pop(7))
        async with asyncio.timeout(PATIENCE):
            while len(read) < len(waiting):
                await asyncio.sleep(TURN_SECONDS)
        return waiting

    assert asyncio.run(run()) == [connection for connection, _ in read]
    times = [time for _, time in read]
    assert min(after - before for before, after in pairwise(times)) >= 0.9 * TURN_SECONDS


def test_of_many_connections_whose_wait_is_over_at_the_same_time_one_is_read_in_a_turn() -> None:
    async def run() -> None:
        pairs = connections(Reader(Settings()))
        found = [next(pairs) for _ in range(50)]
        for connection, _ in found:
            connection.hold(1e-6)
        before, turns = 0, 0
        async with asyncio.timeout(PATIENCE):
            while before < len(found):
                await asyncio.sleep(0.0)
                now = sum(transport.is_read for _, transport in found)
                assert now <= before + 1
                turns, before = turns + (now > before), now
        assert turns == len(found)

    asyncio.run(run())


def test_after_a_read_that_was_much_the_next_one_waits_for_its_turn_and_after_a_request_it_does_not() -> None:
    async def run() -> None:
        pairs = connections(Reader(Settings()))
        (heavy, heavy_transport), (light, light_transport) = next(pairs), next(pairs)
        feed(heavy, CHUNKED)
        assert heavy_transport.is_read
        feed(heavy, b"1\r\n \r\n" * 500)
        assert not heavy_transport.is_read
        for _ in range(10):
            feed(light, GET)
            for _ in range(20):
                await asyncio.sleep(0.0)
            assert light_transport.is_read
        async with asyncio.timeout(PATIENCE):
            while not heavy_transport.is_read:
                await asyncio.sleep(TURN_SECONDS)

    asyncio.run(run())


def test_of_many_connections_with_requests_that_were_sent_ahead_one_goes_on_in_a_turn() -> None:
    async def run() -> None:
        application = Reader(Settings())
        pairs = connections(application)
        for connection, _ in [next(pairs) for _ in range(20)]:
            feed(connection, GET * 5)
        for _ in range(20):
            await asyncio.sleep(0.0)
        asked = application.state.asked
        assert asked <= 2 * 20
        async with asyncio.timeout(PATIENCE):
            while asked < 5 * 20:
                before = asked
                await asyncio.sleep(0.0)
                asked = application.state.asked
                assert asked <= before + 1

    asyncio.run(run())


def test_a_connection_that_is_held_anew_or_closed_has_no_turn() -> None:
    async def run() -> None:
        pairs = connections(Reader(Settings()))
        (first, first_transport), (second, _), (third, third_transport) = (next(pairs) for _ in range(3))
        for connection in (first, second, third):
            connection.wait_is_over()
        first.hold(3_600.0)
        second.connection_lost(None)
        third.hold(1e-6)
        async with asyncio.timeout(PATIENCE):
            while not third_transport.is_read:
                await asyncio.sleep(TURN_SECONDS)
        assert not first_transport.is_read
        assert not third._ledger.turns._waiting
        first.connection_lost(None)

    asyncio.run(run())
