"""`POST /v1/chain`: quotes as the service is asked about them, and its answer as tables."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import httpx
import pyarrow as pa

from app.client.errors import BrokenAnswerError
from app.client.exchange import Question
from app.client.questions import ARROW, JSON, table_question
from pricing_core.american.contracts.json_text import plain_json
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.errors import InvalidInputError

TABLES = ("quotes", "carry", "pairs", "dividends")


@dataclass(frozen=True, slots=True, eq=False)
class ChainAnswer:
    """The tables of a fit, see `pricing_core.chains.ChainFit`; dates are texts in them.

    Parameters
    ----------
    quotes, carry, pairs, dividends : pyarrow.Table
    surface : pyarrow.Table, optional
        A row per expiry: how it was fitted, its parameters, and what is proved of it.
    local_volatility : LocalVolatility, optional
    flags : mapping of str to int
    unfitted : mapping of str to str
    share_within_before, share_within_after : float, optional
    """

    quotes: pa.Table
    carry: pa.Table
    pairs: pa.Table
    dividends: pa.Table
    surface: pa.Table | None
    local_volatility: LocalVolatility | None
    flags: Mapping[str, int]
    unfitted: Mapping[str, str]
    share_within_before: float | None
    share_within_after: float | None


def chain_question(
    quotes: Any, rate: Any, cash_dividends: Sequence[Any], valuation_date: object, tolerance: float
) -> Question:
    """Return the question about a chain, its quotes as an Arrow stream."""
    table = quotes if isinstance(quotes, pa.Table) else _read(quotes)
    asked = {"rate": repr(rate) if isinstance(rate, (int, float)) else json.dumps(rate, default=plain_json)}
    asked["tolerance"] = repr(tolerance)
    if cash_dividends:
        asked["cash_dividends"] = json.dumps(list(cash_dividends), default=plain_json)
    if valuation_date is not None:
        asked["valuation_date"] = str(valuation_date).replace(" ", "T")
    question = table_question(f"v1/chain?{urlencode(asked)}", table)
    return Question(question.path, question.body, ARROW, dict(asked), JSON)


def _read(quotes: Any) -> pa.Table:
    from pricing_core.chains import read_chain  # noqa: PLC0415 - needs the extra "batch", which tables do not

    return read_chain(quotes)


def chain_answer(response: httpx.Response) -> ChainAnswer:
    """Return the answer of /v1/chain.

    Raises
    ------
    BrokenAnswerError
        It is not one.
    """
    try:
        answer = json.loads(response.content)
        tables = {name: pa.table(answer[name]) for name in TABLES}
        surface, local = answer["surface"], answer["local_volatility"]
        return ChainAnswer(
            **tables,
            surface=None if surface is None else pa.table(surface),
            local_volatility=None if local is None else LocalVolatility(**local),
            flags=answer["flags"],
            unfitted=answer["unfitted"],
            share_within_before=answer["share_within_before"],
            share_within_after=answer["share_within_after"],
        )
    except (ValueError, TypeError, KeyError, pa.ArrowException, InvalidInputError) as fault:
        raise BrokenAnswerError(f"the answer is not that of a chain: {fault}") from None
