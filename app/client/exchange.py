"""One question and its answer, asked again where that may help: the same steps for both clients.

An exchange is a generator. It yields a `Question` to be sent, and is sent the response or the error of the transport;
or it yields seconds to be waited. It returns the response that holds the answer.
"""

import random
import time
from collections.abc import Generator
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from typing import Any, TypeAlias

import httpx

from app.client.errors import BrokenAnswerError, ServiceRefusedError, ServiceUnavailableError
from pricing_core.errors import InvalidInputError, NumericalError

FIRST_WAIT, LONGEST_WAIT = 0.25, 30.0  # seconds between attempts where the service names none; doubling
LONGEST_RETRY_AFTER = 120.0  # seconds that a service may ask for; chosen
BUSY = (429, 502, 503, 504)
PROBLEM = "application/problem+json"


@dataclass(frozen=True, slots=True)
class Question:
    """A request that is sent to the service.

    Parameters
    ----------
    path : str
        Behind the address of the service.
    body : bytes
    media_type : str
        Media type of the body, and of the answer unless `answer_type` is another.
    asked : mapping of str to object
        The fields of a single contract, for messages.
    answer_type : str, optional
    """

    path: str
    body: bytes
    media_type: str
    asked: dict[str, Any]
    answer_type: str | None = None

    @property
    def accepted(self) -> str:
        """The media type of the answer."""
        return self.answer_type or self.media_type


Exchange: TypeAlias = Generator[
    Question | float, httpx.Response | httpx.TransportError | None, httpx.Response
]


def exchange(question: Question, attempts: int) -> Exchange:
    """Ask until there is an answer, at most `attempts` times.

    Raises
    ------
    InvalidInputError, NumericalError
        As the library would raise them.
    ServiceUnavailableError, ServiceRefusedError, BrokenAnswerError
        There is no answer.
    """
    why = ""
    for attempt in range(attempts):
        got = yield question
        assert got is not None
        if isinstance(got, httpx.Response) and got.status_code not in BUSY:
            return _checked(got, question)
        why, wait = _trouble(got)
        if attempt + 1 < attempts:
            backoff = min(FIRST_WAIT * 2.0**attempt, LONGEST_WAIT)
            yield wait if wait is not None else backoff * random.uniform(0.5, 1.0)
    raise ServiceUnavailableError(f"no answer in {attempts} attempts: {why}")


def _trouble(got: httpx.Response | httpx.TransportError) -> tuple[str, float | None]:
    """Return what stands in the way, and how many seconds the service asks to be left alone.

    Raises
    ------
    ServiceUnavailableError
        Asking again would take as long again.
    """
    if isinstance(got, httpx.TransportError):
        return f"{type(got).__name__}: {got}", None
    problem = _problem(got)
    why = f"status {got.status_code}: {problem.get('detail') or problem.get('title') or got.reason_phrase}"
    if str(problem.get("type", "")).endswith("#deadline"):
        raise ServiceUnavailableError(why)
    wait = retry_after(got.headers.get("Retry-After", ""))
    if wait is not None and wait > LONGEST_RETRY_AFTER:
        raise ServiceUnavailableError(f"{why}; the service asks for {wait:.0f} s")
    return why, wait


def retry_after(text: str) -> float | None:
    """Return the seconds that the header Retry-After names, as a number or as a date; None where it names none.

    Examples
    --------
    >>> retry_after("3"), retry_after("soon"), retry_after("Wed, 21 Oct 2015 07:28:00 GMT")
    (3.0, None, 0.0)
    """
    if text.isascii() and text.isdigit():
        return float(text)
    try:
        return max(parsedate_to_datetime(text).timestamp() - time.time(), 0.0)
    except ValueError:
        return None


def _checked(response: httpx.Response, question: Question) -> httpx.Response:
    kind = _media_type(response)
    if response.status_code != httpx.codes.OK:
        raise _refusal(response, question)
    if kind != question.accepted:
        raise BrokenAnswerError(f"the answer must be {question.accepted}, and is {kind or 'of no kind'}")
    return response


def _refusal(response: httpx.Response, question: Question) -> Exception:
    """Return what the answer to a refused question is raised as."""
    problem = _problem(response)
    kind = str(problem.get("type", "")).rpartition("#")[2]
    errors = problem.get("errors")
    if kind == "invalid-input" and isinstance(errors, list) and errors and isinstance(errors[0], dict):
        field, allowed = str(errors[0].get("field", "")), str(errors[0].get("allowed", ""))
        return InvalidInputError(
            field, question.asked.get(field.partition(".")[0].partition("[")[0]), allowed
        )
    told = str(problem.get("detail") or problem.get("title") or response.reason_phrase)
    return (
        NumericalError(told) if kind == "out-of-domain" else ServiceRefusedError(response.status_code, told)
    )


def _problem(response: httpx.Response) -> dict[str, Any]:
    """Return the problem document of an answer; nothing where it has none, as from a proxy in between."""
    if _media_type(response) != PROBLEM:
        return {}
    try:
        found = response.json()
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _media_type(response: httpx.Response) -> str:
    return str(response.headers.get("Content-Type", "")).partition(";")[0].strip().lower()
