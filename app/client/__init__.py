"""A client of the HTTP service, with the types of the library: `Client`, and `AsyncClient` for asyncio."""

from pricing_core.extras import needs_extra

with needs_extra("client"):
    from app.client.chain import ChainAnswer
    from app.client.clients import AsyncClient, Client
from app.client.errors import BrokenAnswerError, ServiceError, ServiceRefusedError, ServiceUnavailableError

__all__ = [
    "AsyncClient",
    "BrokenAnswerError",
    "ChainAnswer",
    "Client",
    "ServiceError",
    "ServiceRefusedError",
    "ServiceUnavailableError",
]
