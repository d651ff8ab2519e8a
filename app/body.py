"""A request's body: bounded in size and time, declared as JSON, validated against a model."""

import asyncio
import difflib
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias, TypeVar

from fastapi import Request
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from app.contract_schema import CURVE, CURVE_IN_WORDS, KEYS, NUMBER
from app.errors import BodyTimeoutError, BodyTooLargeError, InvalidRequestError, UnsupportedMediaTypeError
from app.json_schema import inline_schema
from app.schemas import FieldError
from app.settings import Settings
from app.strict_json import parse_object

Model = TypeVar("Model", bound=BaseModel)
Location: TypeAlias = tuple[int | str, ...]
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
    content = {"application/json": {"schema": inline_schema(model)}}
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
        _unknown_key(found["loc"], names)
        if found["type"] == "extra_forbidden"
        else FieldError(field=_path(found["loc"]), allowed=_allowed(found))
        for found in error.errors(include_url=False, include_input=False)
    ]


def _path(location: Location) -> str:
    """Return ("cash_dividends", 1, "amount") as cash_dividends[1].amount, without the kind of a rate."""
    parts = [part for part in location if part not in (NUMBER, CURVE)]
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def _allowed(found: ErrorDetails) -> str:
    """Return what completes "must be ..." from a message such as "Input should be less than 15"."""
    limits: dict[str, Any] = found.get("ctx", {})
    words = {
        "missing": "given",
        "too_long": f"a list of at most {limits.get('max_length')} entries",
        "too_short": "a list that is not empty",
        "string_too_long": f"at most {limits.get('max_length')} characters long",
        "model_type": "a JSON object",
    }
    allowed = words.get(found["type"], found["msg"].removeprefix("Input should be "))
    return f"{allowed} or {CURVE_IN_WORDS}" if found["loc"][-1] == NUMBER else allowed


def _unknown_key(location: Location, names: list[str]) -> FieldError:
    """Name an unknown key only in words of our own: the vocabulary's, or the nearest name."""
    *place, key = location
    if place:
        names = list(KEYS[str(place[0])])
    nearest = difflib.get_close_matches(str(key)[:LONGEST_NAME], names, n=1)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    where = f"every key of {_path(tuple(place))}" if place else "every key"
    return FieldError(field=where, allowed=f"one of {', '.join(names)}{hint}")
