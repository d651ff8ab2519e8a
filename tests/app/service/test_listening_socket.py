import asyncio
import socket

from app.service.listening_socket import listen


def test_an_answer_does_not_wait_until_the_one_before_is_acknowledged() -> None:
    async def no_delay() -> int:
        """Return the option of TCP of a connection that the event loop has accepted."""
        accepted: asyncio.Future[asyncio.StreamWriter] = asyncio.get_running_loop().create_future()
        with listen("127.0.0.1", 0) as listener:
            server = await asyncio.start_server(lambda _, writer: accepted.set_result(writer), sock=listener)
            async with server:
                _, client = await asyncio.open_connection(*listener.getsockname())
                writer = await accepted
                option = writer.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
                for end in (writer, client):
                    end.close()
                    await end.wait_closed()
        return int(option)

    assert asyncio.run(no_delay())
