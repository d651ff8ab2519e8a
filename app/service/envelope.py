"""The envelope of every answer: a request id, security headers, one log line, and never a traceback."""

import asyncio
import logging
import re
import threading
import time
import uuid
from collections.abc import Callable
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.service.clients import is_address, network_of
from app.service.errors import NotReadyError, ProtocolError, problem_response, problem_type
from app.service.metrics import Metrics
from app.service.request_record import RequestRecord

log = logging.getLogger("pricing.requests")

REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
TRACE_PARENT = re.compile(r"00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}")  # W3C Trace Context
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
    metrics : Metrics
        Where requests are counted.
    draining : threading.Event
        Set once the process shuts down: each answer is its connection's last then, as is one that begins before the
        end of the request's body.
    """

    def __init__(self, app: ASGIApp, retry_after: int, metrics: Metrics, draining: threading.Event) -> None:
        self.app = app
        self.retry_after = retry_after
        self.metrics = metrics
        self.draining = draining

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = Headers(scope=scope)
        request_id = request_id_of(given)
        record = RequestRecord(_client(scope), _trace_parent(given))
        at_end: list[Callable[[], None]] = []
        scope.setdefault("state", {}).update(request_id=request_id, record=record, at_end=at_end)
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
                if self.draining.is_set() or _receives(scope):
                    headers["Connection"] = "close"
            await send(message)

        async def refuse(error: Exception) -> None:
            record.problem = problem_type(error).name
            await problem_response(error, request_id, self.retry_after)(scope, receive, send_dressed)

        self.metrics.in_flight.inc()
        try:
            if _is_ambiguous(scope):
                raise ProtocolError("Transfer-Encoding and Content-Length must not be given together")
            await self.app(scope, receive, send_dressed)
        except ProtocolError as refused:
            await refuse(refused)
        except asyncio.CancelledError:  # the grace period is over
            if status:
                raise
            await refuse(NotReadyError("the service is shutting down"))
        except ClientDisconnect:
            status = 499  # the client is gone: nobody to answer
        except Exception as error:
            log.exception("unexpected error", extra={"fields": {"request_id": request_id}})
            if status:  # the answer has begun: all that is left is to break it off
                raise
            await refuse(error)
        finally:
            self.metrics.in_flight.dec()
            for do in at_end:
                do()
            seconds = time.monotonic() - started
            route = getattr(scope.get("route"), "path", None)
            self.metrics.request_ended(route, status, seconds, record)
            log.info("request", extra={"fields": _log_fields(scope, request_id, route, status, seconds)})


def _is_ambiguous(scope: Scope) -> bool:
    """Tell whether a proxy may see another end of the body than the server does (RFC 9112, section 6.3)."""
    names = {name for name, _ in scope["headers"]}
    return b"transfer-encoding" in names and b"content-length" in names


def _receives(scope: Scope) -> bool:
    """Tell whether a part of the request's body is still to come."""
    return bool(scope["state"].get("receives", bool)())


def request_id_of(headers: Headers) -> str:
    """Return the client's request id if it is a short plain word, else a new one."""
    given = headers.get("x-request-id", "")
    return given if REQUEST_ID.fullmatch(given) else uuid.uuid4().hex


def _trace_parent(headers: Headers) -> str | None:
    given = headers.get("traceparent", "")
    return given if TRACE_PARENT.fullmatch(given) else None


def _client(scope: Scope) -> str:
    """Return the client that a proxy names if that is an address, and else whoever has connected."""
    found = scope.get("client") or ("",)
    peer = scope.get("state", {}).get("peer") or found
    return network_of(found[0] if is_address(found[0]) else peer[0])


def _log_fields(
    scope: Scope, request_id: str, route: str | None, status: int, seconds: float
) -> dict[str, Any]:
    """Return the line: of a request that no route takes it holds the path."""
    place = {"route": route} if route else {"path": scope["path"][:LONGEST_PATH]}
    return {
        "request_id": request_id,
        "method": scope["method"],
        **place,
        "status": status,
        "seconds": round(seconds, 6),
        **scope["state"]["record"].fields(),
    }
