"""Cross-origin resource sharing (CORS): which pages of other origins a browser lets ask."""

from collections.abc import Sequence

from starlette.datastructures import Headers
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import Response
from starlette.types import ASGIApp

from app.service.errors import ProtocolError


class CrossOrigin(CORSMiddleware):
    """Lets pages of the named origins ask, with a key but without cookies; `*` is every origin."""

    def __init__(self, app: ASGIApp, origins: Sequence[str]) -> None:
        super().__init__(
            app,
            allow_origins=origins,
            allow_methods=("GET", "HEAD", "POST"),
            allow_headers=("Authorization", "Content-Type", "X-Request-ID", "traceparent"),
            expose_headers=("Retry-After", "X-Request-ID"),
        )

    def preflight_response(self, request_headers: Headers) -> Response:
        """Answer the question that a browser asks before a request.

        Raises
        ------
        ProtocolError
            The origin, the method or a header is not allowed.
        """
        answer = super().preflight_response(request_headers)
        if answer.status_code != 200:
            raise ProtocolError("this origin may not ask this, or not with this method or these headers")
        return answer
