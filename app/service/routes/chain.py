"""POST /v1/chain: quotes of one underlying, fitted."""

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.service.batch.answers import JSON, accepted_form
from app.service.chain.description import CHAIN_OPERATION, CHAIN_RESPONSE
from app.service.chain.fitting import FORMS, fitted_body
from app.service.chain.question import chain_question
from app.service.errors import NotAcceptableError
from app.service.incoming_body import IncomingBody
from app.service.problem_responses import problem_responses
from app.service.request_body import check_encoding, check_length, check_media_type, memory_of
from app.service.work.admission import expensive_lane, expensive_place
from app.service.work.lanes import Interrupt
from app.service.work.route_limits import for_batch

router = APIRouter(tags=["pricing"])


@router.post(
    "/v1/chain",
    openapi_extra=CHAIN_OPERATION,
    response_class=Response,
    responses={200: CHAIN_RESPONSE, **problem_responses(406, 408, 413, 415, 422, 429, 500, 503)},
)
async def post_chain(request: Request) -> Response:
    """Fit quotes of one underlying: carry, volatilities, a surface without arbitrage, a local volatility.

    Quotes as CSV, JSON or an Arrow stream by Content-Type, in the columns of any vendor that is known; what is asked
    besides them stands in the query. A quote that cannot be read or used has a status and flags, an expiry that cannot
    be fitted is named in "unfitted". Where the deadline passes first, the answer is 503 with Retry-After.
    """
    limits = request.state.limits = for_batch(request.app.state.settings)
    check_encoding(request)
    form = check_media_type(request, FORMS)
    if accepted_form(request.headers.getlist("accept"), JSON) != JSON:
        raise NotAcceptableError(f"Accept must name {JSON} or */*")
    question = chain_question(request)
    check_length(request, limits)
    place = expensive_place(request)
    body = IncomingBody(request, limits)
    request.state.at_end.append(body.close)
    content = await body.whole()
    memory = memory_of(request)

    def work(interrupt: Interrupt) -> bytes:
        return fitted_body(content, form, question, memory, interrupt)

    return Response(await expensive_lane(request).run(work, place, body.gone()), media_type=JSON)
