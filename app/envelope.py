"""What every answer carries: a request id, security headers, one log line, and never a traceback."""

import asyncio
import logging
import re
import time
import uuid
from collections.abc import Callable
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import NotReadyError, ProtocolError, problem_response

log = logging.getLogger("pricing.requests")

REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
LONGEST_PATH = 200
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
}


class Envelope:
    """ASGI middleware around the whole application.

    Parameters
    ----------
    retry_after : int
        Seconds; for answers with status 503.
    """

    def __init__(self, app: ASGIApp, retry_after: int) -> None:
        self.app = app
        self.retry_after = retry_after

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request_id = request_id_of(Headers(scope=scope))
        at_end: list[Callable[[], None]] = []
        scope.setdefault("state", {}).update(request_id=request_id, at_end=at_end)
        started = time.monotonic()
        status = 0

        async def send_dressed(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = request_id
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            if _is_ambiguous(scope):
                raise ProtocolError("Transfer-Encoding and Content-Length must not be given together")
            await self.app(scope, receive, send_dressed)
        except ProtocolError as refused:
            await problem_response(refused, request_id, self.retry_after)(scope, receive, send_dressed)
        except asyncio.CancelledError:  # the grace period is over
            if status:
                raise
            closing = NotReadyError("the service is shutting down")
            await problem_response(closing, request_id, self.retry_after)(scope, receive, send_dressed)
        except ClientDisconnect:
            status = 499  # the client is gone: nobody to answer
        except Exception as error:
            log.exception("unexpected error", extra={"fields": {"request_id": request_id}})
            if status:  # the answer has begun: all that is left is to break it off
                raise
            await problem_response(error, request_id, self.retry_after)(scope, receive, send_dressed)
        finally:
            for do in at_end:
                do()
            log.info("request", extra={"fields": _log_fields(scope, request_id, status, started)})


def _is_ambiguous(scope: Scope) -> bool:
    """Tell whether a proxy may see another end of the body than the server does (RFC 9112, section 6.3)."""
    names = {name for name, _ in scope["headers"]}
    return b"transfer-encoding" in names and b"content-length" in names


def request_id_of(headers: Headers) -> str:
    """Return the client's request id if it is a short plain word, else a new one."""
    given = headers.get("x-request-id", "")
    return given if REQUEST_ID.fullmatch(given) else uuid.uuid4().hex


def _log_fields(scope: Scope, request_id: str, status: int, started: float) -> dict[str, Any]:
    return {
        "request_id": request_id,
        "method": scope["method"],
        "path": scope["path"][:LONGEST_PATH],
        "status": status,
        "milliseconds": round(1e3 * (time.monotonic() - started), 3),
    }
