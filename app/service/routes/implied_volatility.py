"""POST /v1/implied-volatility: the volatility at which an option is worth its price."""

import functools
from typing import Annotated

from fastapi import APIRouter, Depends, Request

from app.result_values import by_name, provenance
from app.service.contract_schema import Strict
from app.service.errors import DeadlineError
from app.service.problem_responses import problem_responses
from app.service.request_body import json_body, request_body
from app.service.request_record import record_of
from app.service.schemas import ImpliedVolatilityRequest, ImpliedVolatilityResponse
from app.service.work.admission import answer
from app.service.work.cost_model import seconds_of_search
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_contract
from pricing_core.american import ImpliedVolatility, Market, Option, implied_volatility
from pricing_core.american.contracts.result_fields import IMPLIED_VOLATILITY_FIELDS

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/implied-volatility",
    response_model=ImpliedVolatilityResponse,
    openapi_extra=request_body(ImpliedVolatilityRequest),
    responses=problem_responses(408, 413, 415, 422, 429, 500, 503),
)
async def post_implied_volatility(
    question: Annotated[ImpliedVolatilityRequest, Depends(json_body(ImpliedVolatilityRequest, for_contract))],
    request: Request,
) -> Strict:
    """Find the volatility at which the option is worth option_price, or lies between bid and ask.

    Where there is none, the answer is 200 with a status that says why, and volatility null; where the deadline passes
    first, 503 with Retry-After. Unknown keys are refused.
    """

    @functools.cache
    def contract() -> tuple[Option, Market]:
        return question.contract({"volatility": 1.0})

    def expected() -> float:
        return seconds_of_search(*contract(), question.tolerance)

    def work(interrupt: Interrupt) -> ImpliedVolatility:
        found = implied_volatility(
            *contract(),
            question.option_price,
            bid=question.bid,
            ask=question.ask,
            tolerance=question.tolerance,
            interrupt=interrupt,
        )
        if found.status == "no_convergence" and interrupt():
            raise DeadlineError("the deadline passed first; a wider tolerance is faster")
        return found

    found = await answer(request, work, expected)
    record_of(request).answered(found.status)
    return ImpliedVolatilityResponse(**by_name(IMPLIED_VOLATILITY_FIELDS, found), **provenance())
