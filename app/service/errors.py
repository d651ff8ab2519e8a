"""The answer to each exception: a problem document (RFC 9457), which repeats nothing of the input."""

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from fastapi import FastAPI, Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from app.service.request_record import record_of
from app.service.schemas import FieldError, Problem
from app.service.strict_json import InvalidJsonError
from pricing_core.errors import InvalidInputError, NumericalError


class ServiceError(Exception):
    """A request that the service does not answer; the message is safe to send.

    Parameters
    ----------
    retry_after : int, optional
        Seconds after which it may be asked again, where that is known better than by the settings.
    """

    def __init__(self, message: str, *, retry_after: int | None = None) -> None:
        self.retry_after = retry_after
        super().__init__(message)


@contextmanager
def deadline_told(interrupt: Callable[[], bool], advice: str) -> Iterator[None]:
    """Turn what the library raises where it was interrupted into the deadline's error; other errors pass.

    Raises
    ------
    DeadlineError
        The work was interrupted.
    """
    try:
        yield
    except NumericalError:
        if interrupt():
            raise DeadlineError(f"the deadline passed first; {advice}") from None
        raise


class InvalidRequestError(ServiceError):
    """Fields of the request have values that are not allowed."""

    def __init__(self, faults: Sequence[InvalidInputError]) -> None:
        different = {fault.message_for_strangers: fault for fault in faults}
        self.faults = tuple(different.values())
        told = "; ".join(fault.message_for_strangers for fault in self.faults)
        super().__init__(told.replace("?;", "?"))


class UnauthorizedError(ServiceError):
    """The request has no key that is known; `error` is the word that RFC 6750 has for what is wrong with it."""

    def __init__(self, message: str, error: str = "") -> None:
        self.challenge = 'Bearer realm="pricing"' + (f', error="{error}"' if error else "")
        super().__init__(message)


class UnsupportedMediaTypeError(ServiceError):
    """The body is not declared as plain JSON."""


class InvalidArrowError(ServiceError):
    """The body is not an Arrow stream that the service reads."""


class NotAcceptableError(ServiceError):
    """The answer is asked for in a form that it does not have."""


class BodyTooLargeError(ServiceError):
    """The body is larger than the service reads."""


class ProtocolError(ServiceError):
    """The bytes that arrived are not an HTTP request."""


class BodyTimeoutError(ServiceError):
    """The body did not arrive in time."""


class OverloadedError(ServiceError):
    """Every thread is busy and the queue is full."""


class ClientLimitError(ServiceError):
    """One client asks for more at a time than it may."""


class DeadlineError(ServiceError):
    """The deadline passed before there was anything to answer."""


class NotReadyError(ServiceError):
    """The process is shutting down."""


@dataclass(frozen=True, slots=True)
class ProblemType:
    """Status, the fragment of the type's address in /docs, and its title."""

    status: int
    name: str
    title: str


PROBLEM_TYPES: Mapping[type[Exception], ProblemType] = {
    InvalidInputError: ProblemType(422, "invalid-input", "A field is not what it must be"),
    InvalidRequestError: ProblemType(422, "invalid-input", "A field is not what it must be"),
    InvalidJsonError: ProblemType(422, "invalid-json", "The body is not one valid JSON object"),
    InvalidArrowError: ProblemType(422, "invalid-arrow", "The body is not one valid Arrow stream"),
    NotAcceptableError: ProblemType(406, "not-acceptable", "There is no answer of that kind"),
    UnsupportedMediaTypeError: ProblemType(
        415, "unsupported-media-type", "The body must be application/json"
    ),
    UnauthorizedError: ProblemType(401, "unauthorized", "A key is wanted"),
    ProtocolError: ProblemType(400, "bad-request", "The request is not well-formed HTTP"),
    BodyTooLargeError: ProblemType(413, "body-too-large", "The body is too large"),
    BodyTimeoutError: ProblemType(408, "body-timeout", "The body did not arrive in time"),
    ClientLimitError: ProblemType(429, "client-limit", "This client asks for more at a time than it may"),
    OverloadedError: ProblemType(503, "overloaded", "The service is at its capacity"),
    DeadlineError: ProblemType(503, "deadline", "The deadline passed without an estimate"),
    NotReadyError: ProblemType(503, "not-ready", "The service is not taking requests"),
    NumericalError: ProblemType(422, "out-of-domain", "The method cannot answer this question"),
    Exception: ProblemType(500, "internal-error", "Something is wrong on our side"),
}
HTTP_TYPES: Mapping[int, ProblemType] = {
    404: ProblemType(404, "not-found", "There is nothing at this address"),
    405: ProblemType(405, "method-not-allowed", "This address does not know this method"),
}


# Who asks again at once, whatever Retry-After says, waits so many seconds for each of these answers; chosen.
SLOWED_DOWN, PAUSE_SECONDS = (UnauthorizedError, ClientLimitError, OverloadedError), 1.0


def problem_type(error: Exception) -> ProblemType:
    """Return the row of the nearest class in the table."""
    if isinstance(error, HTTPException):
        other = ProblemType(error.status_code, "http-error", "The request cannot be answered")
        return HTTP_TYPES.get(error.status_code, other)
    return next(PROBLEM_TYPES[kind] for kind in type(error).__mro__ if kind in PROBLEM_TYPES)


def problem_response(error: Exception, request_id: str, retry_after: int) -> Response:
    """Build the answer to a failed request.

    Parameters
    ----------
    request_id : str
        Under which the log holds what the answer does not say.
    retry_after : int
        Seconds, sent with statuses 429 and 503.
    """
    kind = problem_type(error)
    problem = Problem(
        type=f"/docs#{kind.name}",
        title=kind.title,
        status=kind.status,
        detail=_detail(error, kind),
        errors=_field_errors(error),
        request_id=request_id,
    )
    return Response(
        problem.model_dump_json(),
        status_code=kind.status,
        headers=_headers(error, kind.status, retry_after),
        media_type="application/problem+json",
    )


def _headers(error: Exception, status: int, retry_after: int) -> dict[str, str]:
    headers = dict(error.headers or {}) if isinstance(error, HTTPException) else {}
    if isinstance(error, UnauthorizedError):
        headers["WWW-Authenticate"] = error.challenge
    if status in (429, 503):
        known = error.retry_after if isinstance(error, ServiceError) else None
        headers["Retry-After"] = str(known or retry_after)
    if status in (400, 401, 408, 413):
        headers["Connection"] = "close"  # the rest of the body is not read
    return headers


def install_handlers(app: FastAPI, retry_after: int) -> None:
    """Answer every exception of the table; the envelope around the application answers the others."""

    async def answer(request: Request, error: Exception) -> Response:
        record_of(request).problem = problem_type(error).name
        if isinstance(error, SLOWED_DOWN):
            await asyncio.sleep(PAUSE_SECONDS)
        return problem_response(error, request.state.request_id, retry_after)

    for kind in (*PROBLEM_TYPES, HTTPException):
        if kind is not Exception:
            app.add_exception_handler(kind, answer)


def _detail(error: Exception, kind: ProblemType) -> str:
    if isinstance(error, InvalidInputError):
        return error.message_for_strangers
    if isinstance(error, (ServiceError, InvalidJsonError)):
        return str(error)
    if isinstance(error, NumericalError):
        return "the numbers lie where the method does not reach: an extreme rate, volatility, expiry or price"
    if kind.status >= 500:
        return "the log holds the reason under this request id"
    return kind.title


def _field_errors(error: Exception) -> list[FieldError]:
    faults = error.faults if isinstance(error, InvalidRequestError) else (error,)
    return [
        FieldError(field=fault.field, allowed=fault.allowed)
        for fault in faults
        if isinstance(fault, InvalidInputError)
    ]
