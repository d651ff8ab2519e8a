"""A request's body: bounded in size and time, declared as JSON, validated against a model."""

import asyncio
import difflib
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from fastapi import Request
from pydantic import BaseModel, ValidationError

from app.errors import BodyTimeoutError, BodyTooLargeError, InvalidRequestError, UnsupportedMediaTypeError
from app.schemas import LARGEST_TIMES, FieldError
from app.settings import Settings
from app.strict_json import parse_object
from pricing_core.batch.schema import UNSUPPORTED_COLUMNS

Model = TypeVar("Model", bound=BaseModel)
LONGEST_NAME = 40


def json_body(model: type[Model]) -> Callable[[Request], Awaitable[Model]]:
    """Return the dependency that reads a request's body as `model`."""

    async def read(request: Request) -> Model:
        settings: Settings = request.app.state.settings
        _check_media_type(request)
        raw = await _read_bytes(request, settings)
        try:
            return model.model_validate(parse_object(raw))
        except ValidationError as error:
            raise InvalidRequestError(_field_errors(error, model)) from None

    return read


def request_body(model: type[BaseModel]) -> dict[str, Any]:
    """Return the OpenAPI description of the body that `json_body(model)` reads."""
    content = {"application/json": {"schema": model.model_json_schema()}}
    return {"requestBody": {"required": True, "content": content}}


def _check_media_type(request: Request) -> None:
    media_type, _, parameters = request.headers.get("content-type", "").partition(";")
    charset = parameters.strip().lower().removeprefix("charset=").strip('"')
    if media_type.strip().lower() != "application/json" or charset not in ("", "utf-8"):
        raise UnsupportedMediaTypeError("Content-Type must be application/json, in UTF-8")
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        raise UnsupportedMediaTypeError("Content-Encoding must be absent: the body must not be compressed")


async def _read_bytes(request: Request, settings: Settings) -> bytes:
    limit = settings.max_body_bytes
    too_large = BodyTooLargeError(f"the body must not be longer than {limit} bytes")
    declared = request.headers.get("content-length", "")
    if declared.isdecimal() and (len(declared) > 18 or int(declared) > limit):
        raise too_large
    raw = bytearray()
    try:
        async with asyncio.timeout(settings.body_seconds):
            async for part in request.stream():
                raw += part
                if len(raw) > limit:
                    raise too_large
    except TimeoutError:
        raise BodyTimeoutError(f"the body must arrive within {settings.body_seconds:g} s") from None
    return bytes(raw)


def _field_errors(error: ValidationError, model: type[BaseModel]) -> list[FieldError]:
    names = list(model.model_fields)
    return [
        _unknown_key(str(found["loc"][0]), names)
        if found["type"] == "extra_forbidden"
        else FieldError(field=_path(found["loc"]), allowed=_allowed(found["type"], found["msg"]))
        for found in error.errors(include_url=False, include_context=False, include_input=False)
    ]


def _path(location: tuple[int | str, ...]) -> str:
    """Return ("times", 3) as times[3]."""
    return "".join(f"[{part}]" if isinstance(part, int) else str(part) for part in location)


def _allowed(kind: str, message: str) -> str:
    """Return what completes "must be ..." from a message such as "Input should be less than 15"."""
    if kind == "missing":
        return "given"
    if kind in ("too_short", "too_long"):
        return f"a list of 1 to {LARGEST_TIMES} numbers"
    return message.removeprefix("Input should be ")


def _unknown_key(key: str, names: list[str]) -> FieldError:
    """Name an unknown key only in words of our own: the vocabulary's, or the nearest name."""
    if key in UNSUPPORTED_COLUMNS:
        return FieldError(field=key, allowed="absent: this version does not support it")
    nearest = difflib.get_close_matches(key[:LONGEST_NAME], names, n=1)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    return FieldError(field="every key", allowed=f"one of {', '.join(names)}{hint}")
