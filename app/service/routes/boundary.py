"""POST /v1/boundary: the spot at which to exercise, over the life of the option."""

import functools
from typing import Annotated

from fastapi import APIRouter, Depends, Request

from app.result_values import by_name, provenance
from app.service.contract_schema import Strict
from app.service.errors import deadline_told
from app.service.problem_responses import problem_responses
from app.service.request_body import json_body, request_body
from app.service.request_record import record_of
from app.service.schemas import BoundaryRequest, BoundaryResponse
from app.service.work.admission import answer
from app.service.work.cost_model import seconds_of_boundary
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_contract
from pricing_core.american import ExerciseBoundary, Market, Option, exercise_boundary
from pricing_core.american.contracts.result_fields import BOUNDARY_FIELDS

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/boundary",
    response_model=BoundaryResponse,
    openapi_extra=request_body(BoundaryRequest),
    responses=problem_responses(408, 413, 415, 422, 429, 500, 503),
)
async def post_boundary(
    question: Annotated[BoundaryRequest, Depends(json_body(BoundaryRequest, for_contract))], request: Request
) -> Strict:
    """Find the exercise boundary at the asked times.

    Where the deadline passes first, the answer is 503 with Retry-After. Unknown keys are refused.
    """

    @functools.cache
    def contract() -> tuple[Option, Market]:
        return question.contract({"spot": question.strike})

    def expected() -> float:
        return seconds_of_boundary(*contract(), question.tolerance)

    def work(interrupt: Interrupt) -> ExerciseBoundary:
        with deadline_told(interrupt, "a wider tolerance is faster"):
            return exercise_boundary(
                *contract(), question.times, tolerance=question.tolerance, interrupt=interrupt
            )

    found = await answer(request, work, expected)
    record_of(request).answered("ok")
    return BoundaryResponse(**by_name(BOUNDARY_FIELDS, found), **provenance())
