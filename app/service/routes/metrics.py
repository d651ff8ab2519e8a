"""GET /metrics: counts, latencies and present states of the service for Prometheus."""

from fastapi import APIRouter, Request
from fastapi.responses import PlainTextResponse

from app.service.metrics import CONTENT_TYPE, Metrics

router = APIRouter(tags=["health"])


@router.get("/metrics", response_class=PlainTextResponse)
async def get_metrics(request: Request) -> PlainTextResponse:
    """Return counts, latencies and present states of all processes together, in the text format of Prometheus."""
    metrics: Metrics = request.app.state.metrics
    return PlainTextResponse(metrics.text(), media_type=CONTENT_TYPE)
