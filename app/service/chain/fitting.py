"""The quotes in a body, fitted, and the tables of the fit as one JSON object."""

import json
import math
from typing import Any

from app.service.batch.answers import ARROW, JSON
from app.service.batch.arrow_body import flat_table
from app.service.batch.row_limits import LONGEST_COLUMNS
from app.service.chain.question import ChainQuestion
from app.service.decoded_size import bytes_of_csv, bytes_of_json, bytes_of_table
from app.service.errors import BodyTooLargeError, InvalidRequestError, deadline_told
from app.service.memory_budget import HeldMemory
from app.service.strict_json import parse_object
from app.service.work.lanes import Interrupt
from pricing_core.chains import ChainFit, fit_chain
from pricing_core.chains.canonical import RawTable
from pricing_core.chains.fit_tables import tables_of
from pricing_core.chains.raw_files import DELIMITERS, of_arrow, of_csv, of_json
from pricing_core.chains.read_chain import read_raw
from pricing_core.errors import InvalidInputError, Told

CSV = "text/csv"
FORMS = (JSON, CSV, ARROW)
MOST_QUOTES = 20_000  # rows of a body; chosen: the largest chains of one underlying have about half of that
MOST_COLUMNS = 200  # chosen
# Bytes of a place in a column, empty or not; and of what an answer has of a cell, as text and as bytes: JSON writes a
# control character as six.
BYTES_OF_PLACE, BYTES_OF_CHARACTER, BYTES_OF_NUMBER = 16, 12, 48


def fitted_body(
    body: bytes | bytearray, form: str, question: ChainQuestion, memory: HeldMemory, interrupt: Interrupt
) -> bytes:
    """Return the answer to quotes in one of the forms; what they take of the memory is counted before it is taken.

    Raises
    ------
    InvalidJsonError, InvalidArrowError, InvalidRequestError, BodyTooLargeError, DeadlineError
        The body is not what it must be, or the work was interrupted.
    """
    with deadline_told(interrupt, "fewer quotes or a wider tolerance are faster"):
        try:
            raw = _raw(body, form, memory, interrupt)
            quotes = read_raw(
                raw,
                question.format,
                question.underlying_price,
                question.valuation_date,
                lambda fault: fault.message_for_strangers,
            )
            fit = fit_chain(
                quotes,
                question.rate,
                cash_dividends=question.cash_dividends,
                valuation_date=question.valuation_date,
                tolerance=question.tolerance,
                interrupt=interrupt,
            )
        except InvalidInputError as fault:
            raise InvalidRequestError([fault]) from None
        return json.dumps(answer_of(fit), ensure_ascii=False, allow_nan=False, default=str).encode()


def answer_of(fit: ChainFit) -> dict[str, Any]:
    """Return the tables of a fit as columns, with its message and flags, null in the place of NaN."""
    tables = tables_of(fit)
    local = fit.local_volatility
    answer: dict[str, Any] = {
        name: tables[name].to_pydict() if name in tables else None
        for name in ("quotes", "carry", "pairs", "dividends", "surface")
    }
    answer["local_volatility"] = (
        None
        if local is None
        else {name: getattr(local, name).tolist() for name in ("times", "spots", "values")}
    )
    answer["flags"] = dict(fit.flags)
    answer["unfitted"] = fit.unfitted
    answer["share_within_before"] = _number(fit.share_within_before)
    answer["share_within_after"] = _number(fit.share_within_after)
    return answer


def _raw(body: bytes | bytearray, form: str, memory: HeldMemory, interrupt: Interrupt) -> RawTable:
    if form == ARROW:
        table = flat_table(body, MOST_QUOTES, interrupt)
        _check_columns(table.num_columns)
        memory.take(bytes_of_table(table))
        raw = of_arrow(table)
    elif form == JSON:
        if len(body) > LONGEST_COLUMNS:
            raise BodyTooLargeError(
                f"JSON must not be longer than {LONGEST_COLUMNS} bytes: send {CSV} or {ARROW}"
            )
        memory.take(bytes_of_json(body))

        def check(rows: int, columns: int) -> None:
            _check_rows(rows)
            _check_columns(columns)
            memory.take(BYTES_OF_PLACE * rows * columns)

        raw = of_json(parse_object(body, most_bytes=None), check)
    else:
        _check_rows(body.count(b"\n") - 1)
        header = body.lstrip().partition(b"\n")[0]
        _check_columns(1 + max(map(header.count, DELIMITERS.encode())))
        memory.take(bytes_of_csv(body))
        raw = of_csv(_text(body))
    _check_rows(raw.count)
    _check_columns(len(raw.columns))
    memory.take(_bytes_of_answer(raw))
    return _without_infinities(raw)


def _bytes_of_answer(raw: RawTable) -> int:
    """Return a bound of the memory of an answer that holds every cell, as text and as bytes."""
    return sum(
        BYTES_OF_CHARACTER * len(cell) if isinstance(cell, str) else BYTES_OF_NUMBER
        for column in raw.columns.values()
        for cell in column
    )


def _check_rows(count: int) -> None:
    if count > MOST_QUOTES:
        raise BodyTooLargeError(f"a chain must not have more than {MOST_QUOTES} quotes")


def _check_columns(count: int) -> None:
    """Refuse a wide table; asked before it is made where that is known by then, for making it takes long."""
    if count > MOST_COLUMNS:
        raise InvalidInputError("columns", Told(f"{count} columns"), f"at most {MOST_COLUMNS}")


def _without_infinities(raw: RawTable) -> RawTable:
    """Return columns whose infinite or missing numbers, which JSON cannot hold, are none."""
    columns = {
        name: [None if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in column]
        for name, column in raw.columns.items()
    }
    return RawTable(columns, raw.count, raw.faults)


def _text(body: bytes | bytearray) -> str:
    try:
        return body.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInputError("body", Told("other bytes"), "UTF-8 text") from None


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
