"""The head of a request as it arrives: bounded in bytes and lines before it is parsed, and strict about its lines."""

from collections.abc import Iterable

from app.service.errors import ProtocolError

LONGEST_HEAD = 1 << 14  # bytes
MOST_LINES = 100  # of headers; chosen: browsers send about twenty
END = b"\r\n\r\n"
LONGEST_PATH = 1 << 11  # bytes; chosen: each escape in it takes .2 us
VERSIONS = (b" HTTP/1.1", b" HTTP/1.0")  # the parser would take those of RTSP and ICE as well
LEAST_PRINTED = 0x21  # what comes before it begins no request, but TLS or another empty line


class IncomingHead:
    r"""The bytes of a head that have come so far.

    Examples
    --------
    >>> head = IncomingHead()
    >>> head.take(memoryview(b"GET / HTT"))[0]
    b''
    >>> found, rest = head.take(memoryview(b"P/1.1\r\nHost: x\r\n\r\nGET"))
    >>> found, bytes(rest)
    (b'GET / HTTP/1.1\r\nHost: x\r\n\r\n', b'GET')
    """

    def __init__(self) -> None:
        self._bytes = bytearray()

    def take(self, data: memoryview) -> tuple[bytes, memoryview]:
        """Return the head, which is empty while it has no end, and what follows it.

        Raises
        ------
        ProtocolError
            It is too long, has a line that does not end with CR LF, or does not begin with a request line.
        """
        seen = len(self._bytes)
        if not seen and bytes(data[:2]) == b"\r\n":  # an empty line may come before (RFC 9112, section 2.2)
            data = data[2:]
        self._bytes += data
        found = self._bytes.find(END, max(0, seen - len(END) + 1))
        end = found + len(END) if found >= 0 else len(self._bytes)
        if end and self._is_faulty(seen, end):
            raise ProtocolError("the head of the request is malformed or too long")
        if found < 0:
            return b"", data[len(data) :]
        head = bytes(self._bytes[:end])
        self._bytes.clear()
        line = head.partition(b"\r\n")[0]
        if line.count(b" ") != 2 or not line.endswith(VERSIONS):
            raise ProtocolError("the request line must be a method, a target, and HTTP/1.1 or HTTP/1.0")
        return head, data[end - seen :]

    def _is_faulty(self, seen: int, end: int) -> bool:
        lines = self._bytes.count(b"\n", seen, end)
        return (
            end > LONGEST_HEAD
            or self._bytes[0] < LEAST_PRINTED
            or lines != self._bytes.count(b"\r\n", max(0, seen - 1), end)
            or (lines > 0 and self._bytes.count(b"\n", 0, end) > MOST_LINES + 2)
        )


def without_upgrade(head: bytes) -> bytes:
    r"""Return a head without its Upgrade headers, which a server may ignore (RFC 9110, section 7.8).

    Examples
    --------
    >>> without_upgrade(b"GET / HTTP/1.1\r\nupgrade: h2c\r\nHost: x\r\n\r\n")
    b'GET / HTTP/1.1\r\nHost: x\r\n\r\n'
    """
    if b"\nupgrade:" not in head.lower():
        return head
    lines = head.split(b"\r\n")
    return b"\r\n".join(line for line in lines if not line.lower().startswith(b"upgrade:"))


def check_request(target: bytes, version: str, headers: Iterable[tuple[bytes, bytes]]) -> None:
    """Check what the parser leaves open: the path's length, one Host, and no coding but chunked.

    Raises
    ------
    ProtocolError
        One of them is not as HTTP/1.1 has it.
    """
    if len(target.partition(b"?")[0]) > LONGEST_PATH:
        raise ProtocolError("the path is too long")
    hosts = sum(name == b"host" for name, _ in headers)
    if hosts > 1 or (hosts == 0 and version == "1.1"):
        raise ProtocolError("there must be one Host")
    if any(name == b"transfer-encoding" and value.lower() != b"chunked" for name, value in headers):
        raise ProtocolError("Transfer-Encoding must be chunked")
