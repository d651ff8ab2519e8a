"""Where the service listens, and its limits, from the environment: PRICING_SLOTS=4 sets `slots`."""

import ipaddress
import os
import re
import socket
from collections.abc import Iterator
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator, Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from pricing_core.errors import InvalidInputError, UnknownNameError

PREFIX = "PRICING_"
# The variables that are no settings: those that Kubernetes sets for a service called "pricing", and those that the
# installation and the benchmarks read.
NO_SETTING = re.compile(PREFIX + "((PORT|SERVICE)(_|$)|CORE_KERNEL$|(SICONOS|NOSNOC)_PYTHON$)")
# What Kubernetes has in PRICING_PORT.
SERVICE_ADDRESS = re.compile("(tcp|udp|sctp)://")


def known_host(name: str) -> str:
    """Return the name of a host, or its address, if it is known here.

    Raises
    ------
    ValueError
        It is not.
    """
    try:
        socket.getaddrinfo(name, None)
    except OSError:
        raise ValueError("no host") from None
    return name


def named_networks(names: str) -> str:
    """Return the names if each is an address or a network.

    Raises
    ------
    ValueError
        One is neither.
    """
    for name in parts(names):
        ipaddress.ip_network(name, strict=False)
    return names


def named_origins(names: str) -> str:
    """Return the names if each is an origin, or `*`.

    Raises
    ------
    ValueError
        One is neither.
    """
    for name in parts(names):
        found = urlsplit(name)
        if name != "*" and not (
            found.scheme in ("http", "https") and found.netloc and name.endswith(found.netloc)
        ):
            raise ValueError("no origin")
    return names


def parts(names: str) -> list[str]:
    """Return the parts of a text between its commas."""
    return [name.strip() for name in names.split(",") if name.strip()]


Host = Annotated[str, AfterValidator(known_host)]
Networks = Annotated[str, AfterValidator(named_networks)]
Origins = Annotated[str, AfterValidator(named_origins)]
# What completes "must be ..." for the types of this module.
IN_WORDS = {
    "host": "an address of this machine, or a name for one",
    "trusted_proxies": "addresses or networks, with commas between them",
    "cors_origins": "origins such as https://desk.example, with commas between them, or *",
}


class Settings(BaseSettings):
    """The settings that an operator may make; they are read when the application is created, never at import."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, allow_inf_nan=False)

    host: Host = Field(default="127.0.0.1", description="The address to listen at; 0.0.0.0 is every one.")
    port: int = Field(default=8000, ge=0, le=65535, description="The port to listen at; 0 takes a free one.")
    workers: int = Field(
        default=1, ge=1, le=64, description="Processes on that port; each has the limits below to itself."
    )
    slots: int = Field(
        default_factory=lambda: max(2, os.cpu_count() or 1),
        ge=1,
        le=256,
        description="Threads for expensive questions; the default is the number of processors, and at least 2.",
    )
    queue: int = Field(
        default=64, ge=0, le=100_000, description="Expensive questions that may wait for a thread."
    )
    client_queue: int = Field(
        default=8, ge=1, le=100_000, description="Of those that wait or are in work, one client's."
    )
    deadline_seconds: float = Field(
        default=10.0, gt=0.0, le=3600.0, description="For a question, waiting included."
    )
    max_body_bytes: int = Field(
        default=1 << 20, ge=256, le=1 << 30, description="Of a request for one contract."
    )
    max_batch_bytes: int = Field(
        default=3 << 24, ge=256, le=1 << 30, description="Of a body of /v1/batch or /v1/chain."
    )
    batch_deadline_seconds: float = Field(
        default=60.0,
        gt=0.0,
        le=3600.0,
        description="For such a body; rows of a batch that are not priced then have the status deadline.",
    )
    body_seconds: float = Field(
        default=10.0, gt=0.0, le=3600.0, description="To receive the body of a request."
    )
    head_seconds: float = Field(
        default=10.0,
        gt=0.0,
        le=3600.0,
        description="To receive the first lines of a request; a connection that is idle for so long is closed.",
    )
    stall_seconds: float = Field(
        default=10.0,
        gt=0.0,
        le=3600.0,
        description="That a client may read nothing while an answer waits to be sent.",
    )
    retry_after_seconds: int = Field(
        default=1, ge=1, le=3600, description="Told to clients that are answered 429 or 503."
    )
    drain_seconds: float = Field(
        default=1.0, ge=0.0, le=300.0, description="From SIGTERM until connections are refused."
    )
    grace_seconds: int = Field(
        default=30, ge=1, le=3600, description="For what is in work after that; then the process ends."
    )
    max_connections: int = Field(
        default=500, ge=1, le=100_000, description="Open at a time; for one more the idlest is closed."
    )
    client_connections: int = Field(default=100, ge=1, le=100_000, description="Of them, one address's.")
    trusted_proxies: Networks = Field(
        default="",
        description="Addresses or networks, with commas, whose X-Forwarded-For and X-Forwarded-Proto are believed.",
    )
    cors_origins: Origins = Field(
        default="",
        description="Origins, with commas, whose pages may ask; * is every one. Without any CORS is off.",
    )
    api_keys_file: str = Field(
        default="", description="File of API keys; where it is set every /v1 route wants one."
    )
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = Field(
        default="INFO", description="Of the lines on standard error; that of each request is INFO."
    )

    @field_validator("port", mode="before")
    @classmethod
    def _own_port(cls, value: object) -> object:
        of_kubernetes = isinstance(value, str) and SERVICE_ADDRESS.match(value)
        return cls.model_fields["port"].default if of_kubernetes else value


def settings_from_environment(**options: str | int | None) -> Settings:
    """Return the settings that the environment variables make.

    Parameters
    ----------
    **options : str, int or None
        Settings that the command line has; they win over their variables. None is no setting.

    Raises
    ------
    InvalidInputError
        An option or a variable does not hold what its setting must be, or there is no setting for a variable.
    """
    names = sorted(PREFIX + name.upper() for name in Settings.model_fields)
    for variable in os.environ:
        unknown = variable.upper().startswith(PREFIX) and variable.upper() not in names
        if unknown and not NO_SETTING.match(variable):
            # Without its value: a misspelt setting may be somebody's secret.
            raise UnknownNameError("environment variable", [variable], names)
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    try:
        return Settings(**given)
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        name = str(found["loc"][0])
        allowed = IN_WORDS.get(name) or found["msg"].removeprefix("Input should be ").partition(", unable")[0]
        told = f"--{name}" if name in given else PREFIX + name.upper()
        raise InvalidInputError(told, found["input"], allowed) from None


def settings_table() -> str:
    """Return the settings as a table in Markdown: variable, default, what is allowed, meaning."""
    return "\n".join(
        ["| variable | default | allowed | meaning |", "|---|---|---|---|", *map(_row, Settings.model_fields)]
    )


def _row(name: str) -> str:
    field = Settings.model_fields[name]
    default = "" if field.default_factory is not None or field.default == "" else f"`{field.default}`"
    cells = (f"`{PREFIX}{name.upper()}`", default, " ".join(_allowed(field)), str(field.description))
    return "| " + " | ".join(cells) + " |"


def _allowed(field: Any) -> Iterator[str]:
    choices = getattr(field.annotation, "__args__", ())
    if choices:
        yield " or ".join(f"`{choice}`" for choice in choices)
    for limit in field.metadata:
        if isinstance(limit, Gt):
            yield f"above {limit.gt:g}"
        elif isinstance(limit, Ge):
            yield f"from {limit.ge:,g}"
        elif isinstance(limit, Le):
            yield f"to {limit.le:,.0f}"
