"""POST /v1/surface: one option over times and spots."""

import functools
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response

from app.result_values import surface_by_name
from app.service.errors import deadline_told
from app.service.problem_responses import problem_responses
from app.service.request_body import json_body, memory_of, request_body
from app.service.request_record import record_of
from app.service.schemas import SurfaceRequest, SurfaceResponse
from app.service.work.admission import answer
from app.service.work.cost_model import seconds_of_surface
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_contract
from pricing_core.american import Market, Option, value_surface
from pricing_core.american.book.book import Book
from pricing_core.errors import InvalidInputError, Told

router = APIRouter(tags=["pricing"])
# Largest product of times, spots and pieces between events: each takes memory until the answer is sent; chosen.
MOST_POINTS = 50_000
BYTES_OF_POINT = 600  # of memory, for its numbers and the answer as objects, text and bytes; measured: 500


@router.post(
    "/v1/surface",
    response_model=SurfaceResponse,
    openapi_extra=request_body(SurfaceRequest),
    responses=problem_responses(408, 413, 415, 422, 429, 500, 503),
)
async def post_surface(
    question: Annotated[SurfaceRequest, Depends(json_body(SurfaceRequest, for_contract))], request: Request
) -> Response:
    """Value the option at every pair of a time and a spot, just after what happens at that time.

    Where the deadline passes first, the answer is 503 with Retry-After. Unknown keys are refused.
    """
    points = len(question.times), len(question.spots)

    @functools.cache
    def contract() -> tuple[Option, Market]:
        option, market = question.contract({"spot": max(*question.spots, question.strike)})
        pieces = Book.of([(option, market)]).segments.end.size
        if points[0] * points[1] * pieces > MOST_POINTS:
            count = Told(f"{points[0]} x {points[1]} x {pieces}")
            allowed = f"at most {MOST_POINTS} together: fewer times or spots"
            raise InvalidInputError("times x spots x pieces between events", count, allowed)
        return option, market

    def expected() -> float:
        return seconds_of_surface(*contract(), question.tolerance, question.greeks, points)

    def work(interrupt: Interrupt) -> tuple[str, str, str]:
        """Return status and method, and the answer: to write 50,000 values takes long as well."""
        with deadline_told(interrupt, "fewer points are faster"):
            found = value_surface(
                *contract(),
                spots=question.spots,
                times=question.times,
                tolerance=question.tolerance,
                greeks=question.greeks,
                interrupt=interrupt,
            )

        values = SurfaceResponse(**surface_by_name(found, question.greeks_units))
        return found.status, found.method, values.model_dump_json(by_alias=True)

    memory_of(request).take(BYTES_OF_POINT * points[0] * points[1])
    status, method, text = await answer(request, work, expected)
    record_of(request).answered(status, method)
    return Response(text, media_type="application/json")
