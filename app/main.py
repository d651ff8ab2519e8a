"""The application: its routes, exception handlers and limits in one place."""

import asyncio
import threading
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from typing import Any

from pricing_core import __version__
from pricing_core.american import Market, Option
from pricing_core.american import price as price_option
from pricing_core.extras import needs_extra

with needs_extra("service"):
    from fastapi import FastAPI, Security

    from app.service import docs_page
    from app.service.api_keys import ApiKey, KeyCheck, read_keys
    from app.service.connection_ledger import ConnectionLedger
    from app.service.cross_origin import CrossOrigin
    from app.service.envelope import Envelope
    from app.service.errors import install_handlers
    from app.service.head_requests import HeadAsGet
    from app.service.memory_budget import MemoryBudget
    from app.service.metrics import Metrics
    from app.service.problem_responses import problem_responses
    from app.service.routes import (
        batch,
        boundary,
        chain,
        exercise_advice,
        health,
        implied_volatility,
        metrics,
        page,
        price,
        surface,
    )
    from app.service.work.cheap_lane import CheapLane
    from app.service.work.lanes import ExpensiveLane
    from app.service.worked_examples import install_examples
    from app.settings import Settings, parts, settings_from_environment

# What is priced before the service is ready.
WARM_UP = Option("put", strike=100.0, expiry=1.0), Market(spot=100.0, rate=0.05, volatility=0.2)


def create_app(settings: Settings | None = None) -> FastAPI:
    """Return the ASGI application of the service.

    Parameters
    ----------
    settings : Settings, optional
        The limits of the service; taken from the environment unless given.

    Raises
    ------
    InvalidInputError
        Read from the environment, a setting is not what it must be; or the file of keys is not.
    OSError
        The file of keys cannot be read.
    """
    settings = settings_from_environment() if settings is None else settings
    app = FastAPI(
        title="Pricing of American options",
        description="American options solved as linear complementarity systems.",
        version=__version__,
        docs_url=None,  # the default pages load scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,
        lifespan=_lifespan,
    )
    app.state.settings = settings
    app.state.draining = threading.Event()
    app.state.metrics = Metrics()
    app.state.ledger = ConnectionLedger(settings)
    keys = read_keys(settings.api_keys_file) if settings.api_keys_file else ()
    for module in (price, batch, boundary, surface, exercise_advice, implied_volatility, chain):
        app.include_router(module.router, **_with_keys(keys))
    for module in (health, metrics, docs_page, page):
        app.include_router(module.router)
    install_examples(app)
    install_handlers(app, settings.retry_after_seconds)
    app.add_middleware(HeadAsGet)
    if settings.cors_origins:
        app.add_middleware(CrossOrigin, origins=parts(settings.cors_origins))
    app.add_middleware(
        Envelope,
        retry_after=settings.retry_after_seconds,
        metrics=app.state.metrics,
        draining=app.state.draining,
    )
    return app


def _with_keys(keys: Iterable[ApiKey]) -> dict[str, Any]:
    """Return what is told of routes that want a key, if there are keys."""
    return {"dependencies": [Security(KeyCheck(keys))], "responses": problem_responses(401)} if keys else {}


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Price once before the first request is answered: who is told that the service is ready can rely on it."""
    found = await asyncio.to_thread(price_option, *WARM_UP, tolerance=1e-4)
    if found.status != "ok":
        raise RuntimeError(f"the first price has the status {found.status}")
    app.state.cheap_lane = CheapLane()
    app.state.memory = MemoryBudget(app.state.settings.max_batch_bytes)
    app.state.expensive_lane = ExpensiveLane(app.state.settings)
    try:
        yield
    finally:
        app.state.draining.set()
        app.state.expensive_lane.close()
