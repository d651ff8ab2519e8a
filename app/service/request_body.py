"""A request's body: bounded in size and time, declared as JSON, validated against a model."""

import asyncio
import functools
import math
import operator
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

from fastapi import Request
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from app.service.clients import client_of
from app.service.contract_schema import CURVE, DATE, DATE_IN_WORDS, KEYS, LOCAL, NUMBER
from app.service.errors import (
    BodyTimeoutError,
    BodyTooLargeError,
    InvalidRequestError,
    UnsupportedMediaTypeError,
)
from app.service.json_schema import inline_schema
from app.service.memory_budget import HeldMemory
from app.service.strict_json import parse_object
from app.service.work.admission import read_body
from app.service.work.route_limits import Limits, RouteLimits
from pricing_core.american.contracts.checks import range_in_words
from pricing_core.american.contracts.field import CURVE_IN_WORDS, Field
from pricing_core.american.contracts.fields import EX_TIME, EXPIRY, INPUT_FIELDS
from pricing_core.errors import InvalidInputError, Told, UnknownNameError

Model = TypeVar("Model", bound=BaseModel)
Location: TypeAlias = tuple[int | str, ...]
# The kinds that a rate or a time may be of, and their types in JSON.
KINDS = {NUMBER: "number", CURVE: "object", DATE: "string", LOCAL: "object"}
FIELDS: Mapping[int | str, Field] = {field.name: field for field in INPUT_FIELDS}
UNKNOWN_KEY = "extra_forbidden"  # as pydantic calls it
# In the place of a number that is none: what was given, in words, and where a date may be meant, how to give one.
JSON_TYPES = {str: "a text", bool: "true or false", type(None): "null", list: "a list", dict: "an object"}
DATE_INSTEAD: Mapping[int | str, str] = {
    EXPIRY.name: "it is in years, and in its place valuation_date and expiration_date may give dates",
    EX_TIME.name: "it is in years, and in its place ex_date gives a date, where there is a valuation_date",
}
SHOWN_ERRORS = 10  # of a body; chosen
LENGTHS = ("too_long", "too_short")  # kinds of fault, as pydantic calls them
# Bytes of a body that every request may hold without a word; what is longer shares the memory of long bodies. Chosen.
UNCOUNTED = 1 << 16
OF_NUMBERS = ("float_type", "finite_number", "greater_than_equal", "less_than_equal")


def json_body(model: type[Model], limits: Limits) -> Callable[[Request], Awaitable[Model]]:
    """Return the dependency that reads a request's body as `model`, and holds the request to the route's limits."""

    async def read(request: Request) -> Model:
        request.state.limits = limits(request.app.state.settings)
        check_encoding(request)
        check_media_type(request, ("application/json",))
        raw = await _read_bytes(request, request.state.limits)
        return await read_body(request, raw, parse)

    def parse(raw: bytes) -> Model:
        try:
            return model.model_validate(without_surplus(parse_object(raw), model))
        except ValidationError as error:
            raise InvalidRequestError(_faults(error, model)) from None

    return read


def without_surplus(body: dict[str, Any], model: type[BaseModel]) -> dict[str, Any]:
    """Drop the unknown keys of a body, and of the objects in it, beyond those that an answer shows.

    Each is a fault that takes a thousand bytes, and a body may have a hundred thousand.
    """
    inside = (
        (KEYS[name], entry)
        for name, part in body.items()
        if name in KEYS
        for entry in (part if isinstance(part, list) else [part])
        if isinstance(entry, dict)
    )
    left = SHOWN_ERRORS
    for known, part in [(model.model_fields, body), *inside]:
        unknown = [key for key in part if key not in known]
        for key in unknown[left:]:
            del part[key]
        left -= min(left, len(unknown))
    return body


def request_body(model: type[BaseModel]) -> dict[str, Any]:
    """Return the OpenAPI description of the body that `json_body(model)` reads."""
    content = {"application/json": {"schema": inline_schema(model)}}
    return {"requestBody": {"required": True, "content": content}}


def check_media_type(request: Request, allowed: Sequence[str]) -> str:
    """Return the media type of a request's body, in UTF-8.

    Raises
    ------
    UnsupportedMediaTypeError
        It is not one of those that are allowed.
    """
    media_type, _, parameters = request.headers.get("content-type", "").partition(";")
    charset = parameters.strip().lower().removeprefix("charset=").strip('"')
    media_type = media_type.strip().lower()
    if media_type not in allowed or charset not in ("", "utf-8"):
        raise UnsupportedMediaTypeError(f"Content-Type must be {' or '.join(allowed)}, in UTF-8")
    return media_type


def check_encoding(request: Request) -> None:
    """Refuse a body that is compressed."""
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        raise UnsupportedMediaTypeError("Content-Encoding must be absent: the body must not be compressed")


def check_length(request: Request, limits: RouteLimits) -> None:
    """Refuse a body that is declared to be too large."""
    declared = request.headers.get("content-length", "")
    if declared.isdecimal() and (len(declared) > 18 or int(declared) > limits.body_bytes):
        raise too_large(limits)


def too_large(limits: RouteLimits) -> BodyTooLargeError:
    """Return the error of a body that is too large."""
    return BodyTooLargeError(f"the body must not be longer than {limits.body_bytes} bytes")


def too_late(limits: RouteLimits) -> BodyTimeoutError:
    """Return the error of a body that is not here in time."""
    return BodyTimeoutError(f"the body must arrive within {limits.body_seconds:g} s")


def memory_of(request: Request) -> HeldMemory:
    """Return what a request holds of the memory budget; it is released when the client has taken the answer."""
    state = request.state
    if not hasattr(state, "memory"):
        held = state.memory = HeldMemory(request.app.state.memory, client_of(request))
        when_sent = getattr(state, "when_sent", operator.call)  # which a server's connection knows alone
        state.at_end.append(lambda: when_sent(held.release))
    memory: HeldMemory = state.memory
    return memory


async def _read_bytes(request: Request, limits: RouteLimits) -> bytes:
    check_length(request, limits)
    raw = bytearray()
    try:
        async with asyncio.timeout(limits.body_seconds):
            async for part in request.stream():
                raw += part
                if len(raw) > limits.body_bytes:
                    raise too_large(limits)
                if len(raw) > UNCOUNTED:
                    memory_of(request).take(len(part))
    except TimeoutError:
        raise too_late(limits) from None
    return bytes(raw)


def _faults(error: ValidationError, model: type[BaseModel]) -> list[InvalidInputError]:
    """Return the first of what is wrong, unknown keys before all: a body may have a thousand faults."""
    found = sorted(error.errors(include_url=False), key=lambda fault: fault["type"] != UNKNOWN_KEY)
    unknown: dict[Location, list[str]] = {}
    others = []
    for fault in found[:SHOWN_ERRORS]:
        *place, last = fault["loc"]
        if fault["type"] == UNKNOWN_KEY:
            unknown.setdefault(tuple(place), []).append(str(last))
        else:
            others.append(InvalidInputError(_path(fault["loc"]), _value(fault), _allowed(fault, model)))
    return [_unknown_keys(place, keys, model) for place, keys in unknown.items()] + others


def _path(location: Location) -> str:
    """Return ("cash_dividends", 1, "amount") as cash_dividends[1].amount, without the kind of a rate."""
    parts = [part for part in location if part not in KINDS]
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def _value(found: ErrorDetails) -> object:
    """Return what was given; the length of a list that is too long or too short."""
    return Told(f"{len(found['input'])} entries") if found["type"] in LENGTHS else found["input"]


def _allowed(found: ErrorDetails, model: type[BaseModel]) -> str:
    """Return what completes "must be ...": of numbers the whole range, as the library has it."""
    limits: dict[str, Any] = found.get("ctx", {})
    place, given = found["loc"], found["input"]
    field = FIELDS.get(place[0]) if len(place) <= 2 else None
    whole = field.allowed if field else "a list"
    words = {
        "missing": "given",
        "too_long": f"a list of at most {limits.get('max_length')} entries",
        "too_short": "a list that is not empty",
        "string_too_long": f"at most {limits.get('max_length')} characters long",
        "bool_type": "true or false",
        "list_type": whole,
        "model_type": whole.removeprefix("a list of "),
    }
    allowed = words.get(found["type"], found["msg"].removeprefix("Input should be "))
    if found["type"] in OF_NUMBERS:
        schema = schema_at(_schema_of(model), place)
        allowed = range_in_words(schema.get("minimum", -math.inf), schema.get("maximum", math.inf))
    if place[-1] == NUMBER:
        allowed = f"{allowed} or {CURVE_IN_WORDS if place[0] in KEYS else DATE_IN_WORDS}"
    if found["type"] == "float_type" and type(given) in JSON_TYPES:
        allowed += f", not {JSON_TYPES[type(given)]}"
        if isinstance(given, str) and place[-1] in DATE_INSTEAD:
            allowed += f"; {DATE_INSTEAD[place[-1]]}"
    return allowed


@functools.cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the model's schema, which takes milliseconds to make."""
    return inline_schema(model)


def schema_at(schema: dict[str, Any], location: Location) -> dict[str, Any]:
    """Return the part of a model's schema that a value of the body is checked against."""
    for part in location:
        if part in KINDS:
            of_kind = [choice for choice in schema["oneOf"] if choice["type"] == KINDS[part]]
            schema = of_kind[-1 if part == LOCAL else 0]
        else:
            schema = schema["items"] if isinstance(part, int) else schema["properties"][part]
        choices = [choice for choice in schema.get("anyOf", [schema]) if choice.get("type") != "null"]
        schema = choices[0]
    return schema


def _unknown_keys(place: Location, keys: Sequence[str], model: type[BaseModel]) -> InvalidInputError:
    names = KEYS[str(place[0])] if place else model.model_fields
    return UnknownNameError("key", keys, names, _path(place) or "the body")
