"""POST /v1/batch: many options, a status for each."""

import logging
from collections.abc import AsyncIterator

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from app.service.batch.answers import ANSWERS, FORMS, accepted_form
from app.service.batch.description import BATCH_OPERATION, BATCH_RESPONSE
from app.service.batch.question import batch_question
from app.service.batch.work import BatchWork
from app.service.errors import ServiceError
from app.service.incoming_body import IncomingBody
from app.service.problem_responses import problem_responses
from app.service.request_body import check_encoding, check_length, check_media_type
from app.service.work.route_limits import for_batch

log = logging.getLogger("pricing.batch")

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/batch",
    openapi_extra=BATCH_OPERATION,
    response_class=Response,
    responses={200: BATCH_RESPONSE, **problem_responses(406, 408, 413, 415, 422, 429, 500, 503)},
)
async def post_batch(request: Request) -> Response:
    """Value many options, each with a status of its own: rows in order, the results alone.

    Columns of one JSON object, JSON lines, or an Arrow stream by Content-Type; the answer likewise by Accept, in the
    form of the question where that is open. JSON lines are answered as they arrive. A row that cannot be read or priced
    has a status and a message, and costs itself alone; rows unfinished at the deadline have the status deadline.
    Where the answer has begun and cannot be ended, the connection is closed before its end.
    """
    limits = request.state.limits = for_batch(request.app.state.settings)
    check_encoding(request)
    form = check_media_type(request, FORMS)
    answer_form = accepted_form(request.headers.getlist("accept"), form)
    question = batch_question(request)
    check_length(request, limits)
    body = IncomingBody(request, limits)
    request.state.at_end.append(body.close)
    work = BatchWork(request, body, form, question.settings, ANSWERS[answer_form](question.units))
    parts = _not_empty(work.answered())
    return StreamedAnswer(await anext(parts, b""), parts, answer_form)


class StreamedAnswer(Response):
    """An answer whose parts are sent as they become ready, the next one when the client has taken the one before.

    Parameters
    ----------
    first : bytes
        What is ready: from here on an error can only break the answer off.
    """

    def __init__(self, first: bytes, parts: AsyncIterator[bytes], media_type: str) -> None:
        self.status_code, self.media_type, self.background = 200, media_type, None
        self._first, self._parts = first, parts
        self.init_headers()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the answer."""
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": self._first, "more_body": True})
        try:
            async for part in self._parts:
                await send({"type": "http.response.body", "body": part, "more_body": True})
        except ServiceError as fault:
            fields = {"request_id": scope["state"]["request_id"], "reason": str(fault)}
            log.warning("the answer was broken off", extra={"fields": fields})
            raise ClientDisconnect from fault
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _not_empty(parts: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    async for part in parts:
        if part:
            yield part
