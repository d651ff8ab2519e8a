"""POST /v1/boundary: the spot at which to exercise, over the life of the option."""

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Depends, Request

from app.body import json_body, request_body
from app.errors import DeadlineError
from app.pool import Interrupt
from app.responses import problem_responses
from app.schemas import BoundaryRequest, BoundaryResponse
from pricing_core.american import ExerciseBoundary, exercise_boundary
from pricing_core.arrays import Vector
from pricing_core.errors import NumericalError

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/boundary",
    openapi_extra=request_body(BoundaryRequest),
    responses=problem_responses(408, 413, 415, 422, 500, 503),
)
async def post_boundary(
    question: Annotated[BoundaryRequest, Depends(json_body(BoundaryRequest))], request: Request
) -> BoundaryResponse:
    """Find the exercise boundary at the asked times.

    Where the deadline passes first, the answer is 503 with Retry-After. Unknown keys are refused.
    """
    option, market = question.contract({"spot": question.strike})

    def work(interrupt: Interrupt) -> ExerciseBoundary:
        try:
            return exercise_boundary(
                option, market, question.times, tolerance=question.tolerance, interrupt=interrupt
            )
        except NumericalError:
            if interrupt():
                raise DeadlineError("the deadline passed first; a wider tolerance is faster") from None
            raise

    found = await request.app.state.pool.run(work)
    return BoundaryResponse(
        time=found.time.tolist(),
        time_to_expiry=found.time_to_expiry.tolist(),
        boundary=null_for_nan(found.boundary),
        other_boundary=None if found.other_boundary is None else null_for_nan(found.other_boundary),
        error_estimate=null_for_nan(found.error_estimate),
    )


def null_for_nan(values: Vector) -> list[float | None]:
    """Return the numbers, None where there is no boundary; an infinity stays for the response to refuse."""
    return [None if np.isnan(value) else value for value in values.tolist()]
