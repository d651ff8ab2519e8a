"""POST /v1/price: one option in one market."""

import functools
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response

from app.greeks_units import in_units
from app.result_values import price_by_name
from app.service.errors import DeadlineError
from app.service.problem_responses import problem_responses
from app.service.request_body import json_body, request_body
from app.service.request_record import record_of
from app.service.schemas import PriceRequest, PriceResponse
from app.service.work.admission import answer_expensive, is_cheap
from app.service.work.cheap_lane import CheapLane
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_contract
from pricing_core.american import Market, Option, Valuation, price
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.tolerances import check_moneyness
from pricing_core.american.expected_cost import expected_seconds

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/price",
    response_model=PriceResponse,
    openapi_extra=request_body(PriceRequest),
    responses=problem_responses(408, 413, 415, 422, 429, 500, 503),
)
async def post_price(
    question: Annotated[PriceRequest, Depends(json_body(PriceRequest, for_contract))], request: Request
) -> Response:
    """Value one option and its sensitivities.

    Where the deadline passes first, the answer is 200 with status deadline if it holds an estimate of the
    price, else 503 with Retry-After. Where the method does not reach, the answer is 422 with type
    out-of-domain. Unknown keys are refused.
    """
    contract = functools.cache(
        question.contract
    )  # of a short body on the event loop, of a long one in a thread
    tolerance, greeks = question.tolerance, question.greeks

    @functools.cache
    def book() -> Book:
        return checked_book(*contract())

    @functools.cache
    def expected() -> float:
        return expected_seconds(book(), tolerance, greeks)

    def work(interrupt: Interrupt) -> Valuation:
        return price(*contract(), tolerance=tolerance, greeks=greeks, interrupt=interrupt)

    valuation: Valuation | None = None
    if is_cheap(request, expected):
        lane: CheapLane = request.app.state.cheap_lane
        valuation = await lane.price(contract(), book(), tolerance, greeks, expected())
    if valuation is None:
        valuation = await answer_expensive(request, work)
    record_of(request).answered(valuation.status, valuation.method)
    if valuation.status == "deadline" and valuation.price is None:
        raise DeadlineError("the deadline passed before there was an estimate; a wider tolerance is faster")
    found = price_by_name(valuation, greek_errors=question.greek_errors)
    checked = PriceResponse(**in_units(found, question.greeks_units))
    # Written here: FastAPI would check it once more, and make a dictionary of it first.
    return Response(checked.model_dump_json(exclude_unset=True), media_type="application/json")


def checked_book(option: Option, market: Market) -> Book:
    """Return the book of one contract.

    Raises
    ------
    InvalidInputError
        Spot and strike are too far apart, or escrowed dividends are worth the spot or more.
    """
    check_moneyness(option, market.spot)
    return Book.of([(option, market)])
