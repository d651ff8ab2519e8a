"""Liveness, readiness and version; none of them waits for the pricing threads."""

from fastapi import APIRouter, Request

from app.service.errors import NotReadyError
from app.service.problem_responses import problem_responses
from app.service.schemas import HealthResponse
from pricing_core import __version__, kernel_name

router = APIRouter(tags=["health"])


@router.get("/livez")
async def get_livez() -> HealthResponse:
    """Return that the process answers."""
    return _health("alive")


@router.get("/readyz", responses=problem_responses(503))
async def get_readyz(request: Request) -> HealthResponse:
    """Return whether requests should be sent here: 503 from SIGTERM on."""
    if request.app.state.draining.is_set():
        raise NotReadyError("the service is shutting down")
    return _health("ready")


@router.get("/version")
async def get_version() -> HealthResponse:
    """Return the version and the kernel in use."""
    return _health("alive")


def _health(status: str) -> HealthResponse:
    return HealthResponse(status=status, version=__version__, kernel=kernel_name())
