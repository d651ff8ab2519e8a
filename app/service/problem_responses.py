"""The problems that an operation may answer with, as the OpenAPI description states them."""

from typing import Any

from app.service.json_schema import inline_schema
from app.service.schemas import Problem

MEANINGS = {
    401: "The key is missing or not known.",
    406: "The answer is asked for in a form that it does not have.",
    408: "The body did not arrive in time.",
    413: "The body is too large.",
    415: "The body is not declared as application/json.",
    422: "The body is not one JSON object, a field is not what it must be, or the method does not reach.",
    429: "This client has as many expensive questions in work as it may; see Retry-After.",
    500: "Something is wrong on our side; the log holds the reason under the request id.",
    503: "At capacity, shutting down, or out of time without an estimate; see Retry-After.",
}


def problem_responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the `responses` of a route for these statuses."""
    content = {"application/problem+json": {"schema": inline_schema(Problem)}}
    return {status: {"description": MEANINGS[status], "content": content} for status in statuses}
