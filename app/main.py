"""The application: routes, handlers, limits, put together."""

import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from pricing_core import __version__
from pricing_core.extras import needs_extra

with needs_extra("service"):
    from fastapi import FastAPI

    from app import docs_page
    from app.cheap_lane import CheapLane
    from app.connection_ledger import ConnectionLedger
    from app.envelope import Envelope
    from app.errors import install_handlers
    from app.head_requests import HeadAsGet
    from app.lanes import ExpensiveLane
    from app.routes import boundary, health, implied_volatility, price
    from app.settings import Settings, settings_from_environment


def create_app(settings: Settings | None = None) -> FastAPI:
    """Build the service.

    Parameters
    ----------
    settings : Settings, optional
        The limits of the service; taken from the environment unless given.

    Raises
    ------
    InvalidInputError
        Read from the environment, a setting is not what it must be.
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
    app.state.ledger = ConnectionLedger(settings)
    for module in (price, boundary, implied_volatility, health, docs_page):
        app.include_router(module.router)
    install_handlers(app, settings.retry_after_seconds)
    app.add_middleware(HeadAsGet)
    app.add_middleware(Envelope, retry_after=settings.retry_after_seconds)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.cheap_lane = CheapLane()
    app.state.expensive_lane = ExpensiveLane(app.state.settings)
    try:
        yield
    finally:
        app.state.draining.set()
        app.state.expensive_lane.close()
