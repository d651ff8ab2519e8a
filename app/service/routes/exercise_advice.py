"""POST /v1/exercise-advice: when the option will be exercised, and what waiting costs."""

import functools
from typing import Annotated

from fastapi import APIRouter, Depends, Request

from app.result_values import advice_by_name, provenance
from app.service.contract_schema import Strict
from app.service.errors import deadline_told
from app.service.problem_responses import problem_responses
from app.service.request_body import json_body, request_body
from app.service.request_record import record_of
from app.service.schemas import AdviceRequest, AdviceResponse
from app.service.work.admission import answer
from app.service.work.cost_model import seconds_of_advice
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_contract
from pricing_core.american import ExerciseAdvice, Market, Option, exercise_advice
from pricing_core.american.advice.exercise_advice import EVEN_STEPS

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/exercise-advice",
    response_model=AdviceResponse,
    openapi_extra=request_body(AdviceRequest),
    responses=problem_responses(408, 413, 415, 422, 429, 500, 503),
)
async def post_exercise_advice(
    question: Annotated[AdviceRequest, Depends(json_body(AdviceRequest, for_contract))], request: Request
) -> Strict:
    """Say whether to exercise, when the holder will have exercised, and what waiting costs.

    Where the deadline passes first, the answer is 503 with Retry-After. Unknown keys are refused.
    """

    @functools.cache
    def contract() -> tuple[Option, Market]:
        return question.contract()

    def expected() -> float:
        return seconds_of_advice(*contract(), question.tolerance, len(question.times or ()) or EVEN_STEPS)

    def work(interrupt: Interrupt) -> ExerciseAdvice:
        with deadline_told(interrupt, "fewer times or a wider tolerance are faster"):
            return exercise_advice(
                *contract(), question.times, tolerance=question.tolerance, interrupt=interrupt
            )

    found = await answer(request, work, expected)
    record_of(request).answered(found.status, found.method)
    return AdviceResponse(**advice_by_name(found), **provenance())
