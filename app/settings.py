"""The service's limits, from the environment: PRICING_SLOTS=4 sets `slots`."""

import os
import re
from typing import Literal

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from pricing_core.errors import InvalidInputError

PREFIX = "PRICING_"


class Settings(BaseSettings):
    """What an operator may set; read when the application is created, never at import."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, allow_inf_nan=False)

    slots: int = Field(
        default_factory=lambda: max(2, os.cpu_count() or 1), ge=1, le=256
    )  # expensive ones at a time
    queue: int = Field(default=64, ge=0, le=100_000)  # expensive requests that may wait for a slot
    client_queue: int = Field(default=8, ge=1, le=100_000)  # of them, and of those in work, one client's
    deadline_seconds: float = Field(default=10.0, gt=0.0, le=3600.0)  # per request, waiting included
    max_body_bytes: int = Field(default=65_536, ge=256, le=1 << 30)
    body_seconds: float = Field(default=10.0, gt=0.0, le=3600.0)  # to receive a request's body
    retry_after_seconds: int = Field(default=1, ge=1, le=3600)  # told to clients when overloaded
    drain_seconds: float = Field(default=1.0, ge=0.0, le=300.0)  # from SIGTERM to no new connections
    grace_seconds: int = Field(default=30, ge=1, le=3600)  # for requests in flight after that
    max_connections: int = Field(
        default=500, ge=1, le=100_000
    )  # open at a time; beyond it the idlest is closed
    client_connections: int = Field(default=100, ge=1, le=100_000)  # of them, one address's
    trusted_proxies: str = ""  # addresses, with commas, whose X-Forwarded-For is believed
    head_seconds: float = Field(default=10.0, gt=0.0, le=3600.0)  # to receive a request's first lines
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = "INFO"


# What Kubernetes sets for a service that is called "pricing".
SERVICE_LINK = re.compile(PREFIX + "(PORT|SERVICE)(_|$)")


def settings_from_environment() -> Settings:
    """Read the environment.

    Raises
    ------
    InvalidInputError
        A variable does not hold what its setting must be, or there is no setting for it.
    """
    names = {PREFIX + name.upper() for name in Settings.model_fields}
    for variable in os.environ:
        unknown = variable.upper().startswith(PREFIX) and variable.upper() not in names
        if unknown and not SERVICE_LINK.match(variable):
            # Without its value: a misspelt setting may be somebody's secret.
            raise InvalidInputError("environment variable", variable, f"one of {', '.join(sorted(names))}")
    try:
        return Settings()
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        allowed = found["msg"].removeprefix("Input should be ").partition(", unable")[0]
        raise InvalidInputError(PREFIX + str(found["loc"][0]).upper(), found["input"], allowed) from None
