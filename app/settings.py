"""The service's limits, from the environment: PRICING_WORKERS=4 sets `workers`."""

import os

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """What an operator may set; read when the application is created, never at import."""

    model_config = SettingsConfigDict(env_prefix="PRICING_", frozen=True)

    workers: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=1, le=256)  # pricing threads
    queue: int = Field(default=16, ge=0, le=100_000)  # requests that may wait for a thread
    deadline_seconds: float = Field(default=10.0, gt=0.0, le=3600.0)  # per request, waiting included
    max_body_bytes: int = Field(default=65_536, ge=256, le=1 << 30)
    body_seconds: float = Field(default=10.0, gt=0.0, le=3600.0)  # to receive a request's body
    retry_after_seconds: int = Field(default=1, ge=1, le=3600)  # told to clients when overloaded
    drain_seconds: float = Field(default=1.0, ge=0.0, le=300.0)  # from SIGTERM to no new connections
    grace_seconds: int = Field(default=30, ge=1, le=3600)  # for requests in flight after that
    log_level: str = Field(default="INFO", pattern="^(DEBUG|INFO|WARNING|ERROR)$")
