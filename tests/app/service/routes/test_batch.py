import asyncio
import json
import math
import struct
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from fastapi.testclient import TestClient

from app.greeks_units import PER_DAY_PER_POINT
from app.main import create_app
from app.service.batch.answers import ANSWERS, ARROW, FORMS, JSON, LINES
from app.service.batch.arrow_body import ROWS_AT_A_TIME, ArrowRows, _checked, _is_compressed, table_of
from app.service.batch.json_rows import JsonColumns, JsonLines
from app.service.batch.json_rows import columns_of as columns_of_body
from app.service.batch.row_limits import FIELDS, LONGEST_COLUMNS, MOST_JSON_ROWS, PIECE_WEIGHT
from app.service.batch.work import BatchWork
from app.service.decoded_size import bytes_of_json
from app.service.errors import DeadlineError
from app.service.incoming_body import MOST_LINES
from app.service.memory_budget import HeldMemory, MemoryBudget
from app.service.work.lanes import Place
from app.settings import Settings
from pricing_core.american import price_many
from pricing_core.american.arrow import arrow_column
from pricing_core.american.arrow.arrow_column import ArrowColumn
from pricing_core.american.arrow.price_batch import results_schema, unfinished_rows
from pricing_core.american.contracts.result_fields import PRICE_FIELDS
from pricing_core.american.pricing_settings import PricingSettings
from tests.app.service.test_hostile_inputs import CANARY, assert_problem
from tests.problems.needs_kernel import needs_kernel

BOOK = {
    "option_type": ["put", "call", "put"],
    "spot": [90.0, 110.0, 100.0],
    "strike": [100.0, 100.0, 100.0],
    "expiry": [1.0, 0.5, 2.0],
    "rate": [0.05, 0.03, 0.01],
    "volatility": [0.2, 0.3, 0.4],
}
RAW = "application/octet-stream"


def rows_of(columns: dict[str, Any]) -> list[dict[str, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def arrow_stream(table: pa.Table, **options: Any) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=pa.ipc.IpcWriteOptions(**options)) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue().to_pybytes())


def body_of(columns: dict[str, Any], form: str) -> bytes:
    if form == JSON:
        return json.dumps(columns).encode()
    if form == LINES:
        return "\n".join(map(json.dumps, rows_of(columns))).encode()
    return arrow_stream(pa.table(columns))


def ask(client: TestClient, body: bytes, form: str, query: str = "", accept: str = "*/*") -> Any:
    headers = {"content-type": form, "accept": accept}
    return client.post(f"/v1/batch{query}", content=body, headers=headers)


def columns_of(answer: Any) -> dict[str, Any]:
    """Return the answer as columns, whatever its form."""
    assert answer.status_code == 200, answer.text
    form = answer.headers["content-type"]
    if form == JSON:
        found: dict[str, Any] = answer.json()
        return found
    if form == LINES:
        lines = [json.loads(line) for line in answer.text.splitlines()]
        return {name: [line[name] for line in lines] for name in lines[0]}
    table = pa.ipc.open_stream(answer.content).read_all()
    units = {"greeks_units": table.schema.metadata[b"greeks_units"].decode()}
    return {**table.to_pydict(), **units}


def random_book(rng: np.random.Generator, count: int) -> dict[str, Any]:
    """Return contracts of every size of money, some with dividends and curves, some that are none."""
    strike = 10.0 ** rng.uniform(-20.0, 20.0, count)
    curve = {"times": [0.25, 1.0], "values": [0.02, 0.04]}
    book = {
        "option_type": rng.choice(["put", "call"], count).tolist(),
        "strike": strike.tolist(),
        "spot": (strike * rng.uniform(0.8, 1.25, count)).tolist(),
        "expiry": rng.uniform(0.05, 2.0, count).tolist(),
        "rate": [curve if k % 7 == 3 else float(rng.uniform(-0.01, 0.1)) for k in range(count)],
        "volatility": rng.uniform(0.1, 0.6, count).tolist(),
        "dividend_yield": rng.uniform(0.0, 0.05, count).tolist(),
        "cash_dividends": [
            [{"time": 0.3, "amount": 0.01 * strike.item(k)}] if k % 5 == 2 else [] for k in range(count)
        ],
    }
    for place in range(4, count, 11):
        book["spot"][place] = -1.0
    return book


def arrow_book(book: dict[str, Any]) -> bytes:
    """Return the book as a stream; its curves as JSON text."""
    rates = [json.dumps(rate) for rate in book["rate"]]
    return arrow_stream(pa.table({**book, "rate": rates}), allow_64bit=True)


@needs_kernel
@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
@pytest.mark.parametrize("form", FORMS)
def test_every_row_is_what_price_many_says_of_it_in_every_form(
    client: TestClient, form: str, greeks: Any
) -> None:
    book = random_book(np.random.default_rng(290), 40)
    wanted = price_many(book, tolerance=1e-4, greeks=greeks, greek_errors=True)
    body = arrow_book(book) if form == ARROW else body_of(book, form)
    query = f"?tolerance=1e-4&greeks={greeks}&greek_errors=true"
    for accept in FORMS:
        found = columns_of(ask(client, body, form, query, accept))
        for name, column in wanted.items():
            for row, value in enumerate(column.tolist()):
                got = found[name][row]
                if name == "exercise_now" and found["price"][row] is None:
                    assert got is None
                elif name == "message":
                    assert (got or "").partition("=")[0] == value.partition("=")[0]
                elif isinstance(value, tuple):
                    assert tuple(got or ()) == value
                elif isinstance(value, float) and math.isnan(value):
                    assert got is None
                else:
                    assert got == (value or None if isinstance(value, str) else value), (name, row)
        assert set(found["status"]) == {"ok", "invalid_input"}


@needs_kernel
@pytest.mark.parametrize("form", FORMS)
def test_greeks_come_per_day_and_per_point_where_that_is_asked_for(client: TestClient, form: str) -> None:
    book = random_book(np.random.default_rng(291), 12)
    body = arrow_book(book) if form == ARROW else body_of(book, form)
    query = "?tolerance=1e-4&greeks=extended&greek_errors=true"
    plain = columns_of(ask(client, body, form, query))
    scaled = columns_of(ask(client, body, form, f"{query}&greeks_units=per_day_per_point"))
    units = {name: np.unique(found["greeks_units"]).tolist() for name, found in (("a", plain), ("b", scaled))}
    assert units == {"a": ["per_year_per_unit"], "b": ["per_day_per_point"]}
    assert scaled["vega"] == pytest.approx(scaled["vega_per_point"])
    assert scaled["rho"] == pytest.approx(scaled["rho_per_point"])
    assert scaled["theta"] == pytest.approx(scaled["theta_per_day"])
    for field in PRICE_FIELDS:
        by = PER_DAY_PER_POINT.get(field.name, 1.0)
        for name in (field.name, f"{field.name}_error"):
            for before, after in zip(plain.get(name, []), scaled.get(name, []), strict=True):
                if isinstance(before, list):
                    assert after == pytest.approx([by * number for number in before], rel=1e-14)
                elif isinstance(before, float):
                    assert after == pytest.approx(by * before, rel=1e-14)
                else:
                    assert after == before


def test_every_greek_by_time_or_a_parameter_has_its_factor() -> None:
    by_spot_or_amount = {"delta", "delta_sticky_moneyness", "gamma", "dividend_sensitivities"}
    greeks = {field.name for field in PRICE_FIELDS if field.is_greek}
    assert set(PER_DAY_PER_POINT) == greeks - by_spot_or_amount


@needs_kernel
def test_a_bad_row_costs_itself_alone(client: TestClient) -> None:
    rows: list[Any] = rows_of(BOOK)
    deep = '{"spot": ' * 500
    twice = '{"spot": 1, "spot": 2}'
    bad = ["", "nonsense", "[]", "null", deep, twice, '{"spot": NaN}', '{"unknown": 1}']
    bad += [json.dumps(rows[0] | change) for change in WRONG_CELLS]
    good = json.dumps(rows[0])
    lines = "\n".join(f"{line}\n{good}" for line in bad).encode() + b"\n\xff\xfe\n\r\n"
    found = columns_of(ask(client, lines, LINES, "?tolerance=1e-4"))
    assert found["status"] == ["ok", *["invalid_input", "ok"] * (len(bad) - 1), "invalid_input"]
    assert len(set(filter(None, found["price"]))) == 1
    assert all(len(message) < 400 for message in found["message"] if message)


WRONG_CELLS: list[dict[str, Any]] = [
    {"spot": "100"},
    {"spot": True},
    {"spot": None},
    {"spot": [100.0]},
    {"spot": 10**400},
    {"spot": -1},
    {"strike": 0.0},
    {"option_type": 1},
    {"option_type": "straddle"},
    {"expiry": "1"},
    {"rate": "0.05"},
    {"rate": {"times": [1.0], "values": [0.1, 0.2]}},
    {"rate": {"times": [1.0] * 101, "values": [0.1] * 101}},
    {"rate": {"times": 1}},
    {"rate": [0.05]},
    {"cash_dividends": {"time": 1.0}},
    {"cash_dividends": [{"time": 0.5}]},
    {"cash_dividends": [[0.5, 1.0, 2.0]]},
    {"cash_dividends": [{"time": 0.5, "amount": 1.0}] * 367},
    {"cash_dividends": "[]"},
    {"valuation_date": 7},
    {"valuation_date": "2026-01-01" * 5},
    {"tolerance": 1.0},
    {"exercise": "bermudan"},
]


@pytest.mark.parametrize(
    ("body", "form", "status", "name"),
    [
        (b"", JSON, 422, "invalid-json"),
        (b"[]", JSON, 422, "invalid-json"),
        (b'{"spot": [1], "spot": [2]}', JSON, 422, "invalid-json"),
        (b'{"spot": [NaN]}', JSON, 422, "invalid-json"),
        (b"[" * 100_000, JSON, 422, "invalid-json"),
        (b"{}", JSON, 422, "invalid-input"),
        (json.dumps(BOOK | {CANARY: [1, 2, 3]}).encode(), JSON, 422, "invalid-input"),
        (json.dumps(BOOK | {"sopt": [1, 2, 3]}).encode(), JSON, 422, "invalid-input"),
        (json.dumps(BOOK | {"spot": [1.0, 2.0]}).encode(), JSON, 422, "invalid-input"),
        (json.dumps(BOOK | {"spot": [1.0] * (MOST_JSON_ROWS + 1)}).encode(), JSON, 422, "invalid-input"),
        (
            json.dumps(dict.fromkeys(BOOK, 1) | {"spot": [1.0] * (MOST_JSON_ROWS + 1)}).encode(),
            JSON,
            413,
            "body-too-large",
        ),
        (b" " * (LONGEST_COLUMNS + 1), JSON, 413, "body-too-large"),
        (b"x" * 1_100_000, LINES, 413, "body-too-large"),
        (b"", ARROW, 422, "invalid-arrow"),
        (b"x" * 5_000, ARROW, 422, "invalid-arrow"),
        (b"\xff" * 5_000, ARROW, 422, "invalid-arrow"),
        (b"\xff\xff\xff\xff\xff\xff\xff\x7f", ARROW, 422, "invalid-arrow"),
        (arrow_stream(pa.table(BOOK))[:-300], ARROW, 422, "invalid-arrow"),
        (arrow_stream(pa.table(BOOK), compression="lz4"), ARROW, 422, "invalid-arrow"),
        (arrow_stream(pa.table(BOOK), compression="zstd"), ARROW, 422, "invalid-arrow"),
        (b"", RAW, 415, "unsupported-media-type"),
    ],
)
def test_what_is_no_batch_is_a_short_problem(
    client: TestClient, body: bytes, form: str, status: int, name: str
) -> None:
    assert_problem(ask(client, body, form), status, name)


def test_unknown_columns_parameters_and_keys_are_told_with_the_nearest_names(client: TestClient) -> None:
    columns = ask(client, json.dumps(BOOK | {"vol": 0.2, "foo": 1}).encode(), JSON).json()["detail"]
    assert columns.startswith("there is no such column: did you mean volatility?")
    query = ask(client, body_of(BOOK, JSON), JSON, "?tol=1e-3").json()["detail"]
    assert query.startswith("the query has no such parameter: did you mean tolerance?")
    row = {name: cells[0] for name, cells in BOOK.items()} | {"vol": 0.2}
    answer = json.loads(ask(client, json.dumps(row).encode(), LINES, "", LINES).content)
    assert answer["message"].startswith("there is no key 'vol': did you mean volatility?")


def column(name: str, cells: Any) -> pa.Table:
    """Return the book with another column, as long as that is."""
    cells = cells if isinstance(cells, pa.Array) else pa.array(cells)
    count = len(cells)
    others = {
        other: pa.array([values[0]] * count) for other, values in BOOK.items() if count < 10 and other != name
    }
    return pa.table({**others, name: cells})


def twice_named() -> pa.Table:
    table = pa.table(BOOK)
    return table.append_column("spot", table["spot"])


def entries(count: int, kind: pa.DataType) -> pa.Array:
    """Return one list of so many nulls, which take no memory."""
    return pa.ListArray.from_arrays(pa.array([0, count], pa.int32()), pa.nulls(count, kind))


def many_nulls() -> bytes:
    """Return a stream that says that it has 2**40 rows without a buffer."""
    few = arrow_stream(pa.table({name: pa.nulls(123_457) for name in BOOK}))
    return few.replace(struct.pack("<q", 123_457), struct.pack("<q", 2**40))


BOMBS: dict[str, Callable[[], Any]] = {
    "rows without memory": many_nulls,
    "entries without memory": lambda: column("cash_dividends", entries(2**31 - 1, pa.null())),
    "many entries": lambda: column("exercise_times", pa.array([[0.5] * 100_000])),
    "structures without fields": lambda: column("cash_dividends", pa.array([[{}] * 5])),
    "lists of lists": lambda: column("exercise_times", pa.array([[[0.5] * 5] * 5])),
    "flags": lambda: column("spot", pa.array([True, False])),
    "bytes": lambda: column("option_type", pa.array([b"put"])),
    "views": lambda: column("option_type", pa.array(["put"], pa.string_view())),
    "runs": lambda: column("spot", pa.RunEndEncodedArray.from_arrays([5], [100.0])),
    "fixed lists": lambda: column("exercise_times", pa.array([[0.5, 0.6]], pa.list_(pa.float64(), 2))),
    "one long text for all rows": lambda: column(
        "option_type", pa.DictionaryArray.from_arrays(pa.array([0] * 9, pa.int8()), ["p" * 100_000])
    ),
    "a dictionary of numbers": lambda: column("spot", pa.array([100.0]).dictionary_encode()),
    "a map": lambda: column("rate", pa.array([[("a", 1.0)]], pa.map_(pa.string(), pa.float64()))),
    "names twice": twice_named,
    "an unknown name": lambda: column(CANARY, [1.0]),
    "a misspelt name": lambda: column("Cash Dividends", ["[]"]),
    "a missing column": lambda: pa.table({"spot": [1.0]}),
    "many columns": lambda: pa.table({f"{CANARY}{k}": [1.0] for k in range(5_000)}),
    "a dictionary of many texts": lambda: column(
        "option_type", pa.DictionaryArray.from_arrays(pa.array([0] * 9, pa.int8()), [""] * 1_000_001)
    ),
    "many batches": lambda: pa.Table.from_batches(pa.table(BOOK).to_batches() * 5_000),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_stream_that_stands_for_more_than_it_holds_is_refused(client: TestClient, name: str) -> None:
    before = pa.total_allocated_bytes()
    bomb = BOMBS[name]()
    answer = ask(client, bomb if isinstance(bomb, bytes) else arrow_stream(bomb), ARROW)
    assert answer.status_code in (413, 422)
    names = {413: "body-too-large", 422: "invalid-input"}
    assert_problem(answer, answer.status_code, names[answer.status_code])
    assert pa.total_allocated_bytes() < before + 20_000_000


def test_a_shared_list_is_priced_in_bounded_parts(client: TestClient) -> None:
    count = 200
    dividends = [{"time": 2.0 + k / 366, "amount": 0.01} for k in range(366)]  # after expiry
    body = {name: cells[0] for name, cells in BOOK.items()} | {"spot": [100.0] * count, "expiry": 0.0}
    found = columns_of(ask(client, json.dumps(body | {"cash_dividends": dividends}).encode(), JSON))
    assert found["status"] == ["ok"] * count


@needs_kernel
def test_no_flipped_bytes_of_a_stream_are_a_fault_of_ours(client: TestClient) -> None:
    rng = np.random.default_rng(29)
    dividends = [[{"time": 0.5, "amount": 1.0}], [], None]
    whole = arrow_stream(pa.table({**BOOK, "cash_dividends": dividends}))
    statuses = set()
    for _ in range(400):
        flipped = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 4)).tolist():
            flipped[place] = int(rng.choice([0, 1, 127, 128, 255, int(rng.integers(256))]))
        answer = ask(client, bytes(flipped), ARROW, "?tolerance=1e-2&greeks=none")
        statuses.add(answer.status_code)
        assert answer.status_code in (200, 413, 422), answer.text
    assert statuses >= {200, 422}


@pytest.mark.parametrize(
    "query",
    [
        "?tolerance=1",
        "?tolerance=nan",
        "?tolerance=1_0",
        "?greeks=all",
        "?greek_errors=yes",
        "?greeks_units=per_week",
        "?greeks=none&greeks=none",
        f"?{CANARY}=1",
        f"?greeks={CANARY}",
        "?tolerance=",
    ],
)
def test_a_query_that_is_none_is_refused(client: TestClient, query: str) -> None:
    assert_problem(ask(client, body_of(BOOK, JSON), JSON, query), 422, "invalid-input")


@pytest.mark.parametrize("accept", ["text/html", "application/json;q=0", "application/xml, image/*"])
def test_an_answer_of_a_kind_that_there_is_not_is_refused(client: TestClient, accept: str) -> None:
    assert_problem(ask(client, body_of(BOOK, JSON), JSON, accept=accept), 406, "not-acceptable")


def test_accepted_kinds_and_parameters_are_counted_before_they_are_looked_at(client: TestClient) -> None:
    body = body_of(BOOK, JSON)
    assert ask(client, body, JSON, accept=",".join(["application/json"] * 99)).status_code == 200
    assert_problem(
        ask(client, body, JSON, accept=",".join(["application/json"] * 101)), 406, "not-acceptable"
    )
    names = "&".join(f"p{k}" for k in range(101))
    problem = assert_problem(ask(client, body, JSON, "?" + names), 422, "invalid-input")
    assert "fewer than 100 parameters" in problem["detail"]


def test_a_long_schema_is_refused_before_it_is_read(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A message of a megabyte would take many as objects."""
    table = pa.table({f"column_{k}": pa.nulls(0) for k in range(10_000)})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    monkeypatch.setattr("app.service.batch.arrow_body.pa.ipc.open_stream", pytest.fail)
    assert_problem(ask(client, bytes(sink.getvalue()), ARROW), 413, "body-too-large")


def test_blank_lines_after_the_deadline_leave_the_event_loop_to_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("app.service.work.lanes.Place.has_time", lambda self: False)
    turns = []

    async def turn(seconds: float, sleep: Any = asyncio.sleep) -> None:
        turns.append(seconds)
        await sleep(seconds)

    monkeypatch.setattr("app.service.batch.work.asyncio.sleep", turn)
    with TestClient(create_app(Settings(slots=2))) as client:
        answer = ask(client, b"\n" * 100_000, LINES)
    assert (answer.status_code, answer.content) == (200, b"")
    assert turns.count(0) >= 100_000 // MOST_LINES


@needs_kernel
@pytest.mark.parametrize("form", FORMS)
def test_rows_unfinished_at_the_deadline_say_so(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, waited_for: None, form: str
) -> None:
    for rows in (JsonColumns, JsonLines, ArrowRows):

        def late(some: Any, settings: PricingSettings, interrupt: Any, price: Any = rows.price) -> Any:
            """Price once the deadline has passed."""
            return price(some, settings, lambda: True)

        monkeypatch.setattr(rows, "price", late)
    count = 300
    book = {name: [cells[0]] * count for name, cells in BOOK.items()}
    book |= {"rate": [-0.01] * count, "dividend_yield": [-0.02] * count, "expiry": [30.0] * count}
    book["cash_dividends"] = [[{"time": 15.0, "amount": 1.0}]] * count
    found = columns_of(ask(client, body_of(book, form), form, "?tolerance=1e-8&greeks=extended"))
    assert len(found["status"]) == count
    assert set(found["status"]) <= {"ok", "tolerance_not_met", "deadline", "invalid_input"}
    assert found["status"].count("deadline") > 200


def test_a_body_is_counted_while_it_arrives() -> None:
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=10_000))) as client:
        endless = (b" " * 999 + b"\n" for _ in range(1_000))
        headers = {"content-type": LINES}
        assert_problem(client.post("/v1/batch", content=endless, headers=headers), 413, "body-too-large")
        long = {**headers, "content-length": "10001"}
        assert_problem(client.post("/v1/batch", content=b" " * 10_001, headers=long), 413, "body-too-large")
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]


def test_no_rows_are_answered_with_none(client: TestClient) -> None:
    empty = {name: [] for name in BOOK}
    for form in FORMS:
        body = arrow_stream(pa.table(BOOK).slice(0, 0)) if form == ARROW else body_of(empty, form)
        answer = ask(client, body, form, accept=JSON)
        assert columns_of(answer)["status"] == []


def test_the_limits_name_every_column() -> None:
    assert set(BOOK) < set(FIELDS)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("units", ["per_year_per_unit", "per_day_per_point"])
def test_unfinished_rows_are_written_as_if_one_by_one(form: str, units: str) -> None:
    names, settings = ["cash_dividends", "rate"], PricingSettings(1e-6, "extended", True)
    written = []
    for repeats in (True, False):
        answer = ANSWERS[form](units)
        parts = [answer.start(results_schema(names, settings))]
        for count in (1, 7, 300):
            rows = unfinished_rows(1 if repeats else count, names, settings)
            encoded = answer.repeated(rows, count) if repeats else answer.encoded(rows)
            parts.append(answer.add(encoded, count))
        written.append(b"".join([*parts, *answer.end()]))
    found = [content(body, form) for body in written]
    assert found[0] == found[1]
    assert found[0]["status"] == ["deadline"] * 308
    if form != ARROW:
        assert written[0] == written[1]


def content(body: bytes, form: str) -> dict[str, Any]:
    if form == ARROW:
        with pa.ipc.open_stream(body) as stream:
            columns: dict[str, Any] = stream.read_all().to_pydict()
            return columns
    if form == JSON:
        columns = json.loads(body)
        return columns
    rows = [json.loads(line) for line in body.splitlines()]
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.parametrize("form", FORMS)
def test_rows_for_which_no_time_is_left_are_answered_in_few_pieces(
    monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    """The deadline passes before the first row: what is left is told many rows at a time, however it was cut."""
    monkeypatch.setattr("app.service.work.lanes.Place.has_time", lambda self: False)
    monkeypatch.setattr("app.service.batch.json_rows.PIECE_WEIGHT", 1)
    monkeypatch.setattr("app.service.batch.arrow_body.PIECE_WEIGHT", 1)
    asked = []
    kind = ANSWERS[form]
    repeated = kind.repeated
    monkeypatch.setattr(
        kind, "repeated", lambda self, row, count: (asked.append(count), repeated(self, row, count))[1]
    )
    count = 20_000
    book = {name: [cells[0]] * count for name, cells in BOOK.items()}
    with TestClient(create_app(Settings(slots=2))) as client:
        found = columns_of(ask(client, body_of(book, form), form))
    assert found["status"] == ["deadline"] * count
    assert len(asked) <= (2 if form != LINES else 10)  # lines are answered as they come


@pytest.mark.parametrize("form", FORMS)
def test_work_ends_in_time_to_answer_all_rows_as_late(monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    """However many rows are there: as many seconds before the deadline as it takes to send what is said of them."""
    ends: list[float] = []

    def noted(self: Place) -> bool:
        ends.append(self.expires)
        return False

    monkeypatch.setattr("app.service.work.lanes.Place.has_time", noted)
    count, least = 2_000, []
    book = {name: [cells[0]] * count for name, cells in BOOK.items()}
    begun = time.monotonic()
    for rows_a_second in (math.inf, 10.0):
        monkeypatch.setattr(ANSWERS[form], "rows_a_second", rows_a_second)
        ends.clear()
        with TestClient(create_app(Settings(slots=2, batch_deadline_seconds=3600.0))) as client:
            found = columns_of(ask(client, body_of(book, form), form))
        assert found["status"] == ["deadline"] * count
        least.append(min(ends))
    one_line = 0.1  # the last one may have no end
    assert 0.0 <= least[1] - (least[0] - 200.0) <= time.monotonic() - begun + one_line


def test_lines_beyond_the_most_rows_are_refused(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.service.batch.work.MOST_ROWS", 100)
    row = json.dumps({name: cells[0] for name, cells in BOOK.items()}).encode() + b"\n"
    assert_problem(ask(client, row * 101, LINES), 413, "body-too-large")
    assert ask(client, row * 100, LINES).status_code == 200


def test_rows_that_find_no_time_or_no_thread_in_time_are_not_priced_and_say_so(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    priced = []
    price = ArrowRows.price
    monkeypatch.setattr(ArrowRows, "price", lambda *told: (priced.append(1), price(*told))[1])
    times = iter([True])  # when the piece comes, and not when it is its turn
    with monkeypatch.context() as patched:
        patched.setattr("app.service.work.lanes.Place.has_time", lambda self: next(times, False))
        assert set(columns_of(ask(client, body_of(BOOK, ARROW), ARROW))["status"]) == {"deadline"}
    assert not priced

    async def too_late(lane: Any, work: Any, place: Any, gone: Any) -> Any:
        gone.close()
        raise DeadlineError("no thread became free")

    monkeypatch.setattr("app.service.work.lanes.ExpensiveLane.run", too_late)
    assert set(columns_of(ask(client, body_of(BOOK, LINES), LINES))["status"]) == {"deadline"}


def test_an_answer_may_be_longer_than_the_memory_as_long_as_it_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("app.service.incoming_body.MOST_LINES", 10)
    row = json.dumps({name: cells[0] for name, cells in BOOK.items()}).encode() + b"\n"
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=200 * len(row) + 30_000))) as client:
        answer = ask(client, row * 200, LINES, "?greeks=none&tolerance=1e-2")
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]
    assert answer.content.count(b'"status": ') == 200
    assert len(answer.content) > 200 * len(row) + 30_000


def test_rows_as_one_json_object_are_few(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    book = {name: [cells[0]] * 101 for name, cells in BOOK.items()}
    monkeypatch.setattr("app.service.batch.answers.MOST_JSON_ROWS", 100)
    assert_problem(ask(client, body_of(book, LINES), LINES, accept=JSON), 413, "body-too-large")
    assert ask(client, body_of(book, LINES), LINES).status_code == 200
    monkeypatch.setattr("app.service.batch.json_rows.MOST_JSON_ROWS", 100)
    assert_problem(ask(client, body_of(book, JSON), JSON, accept=LINES), 413, "body-too-large")


@pytest.mark.parametrize(("shared", "each"), [(300, 0), (0, 300), (0, 0)])
def test_columns_are_priced_in_pieces_of_few_entries(shared: int, each: int) -> None:
    count = 10_000 if shared + each == 0 else 500
    entry = {"time": 0.5, "amount": 0.01}
    columns = {name: cells[0] for name, cells in BOOK.items()} | {"spot": [100.0] * count}
    if shared:
        columns["cash_dividends"] = [entry] * shared
    if each:
        columns["cash_dividends"] = [[entry] * each] * count
    pieces = columns_of_body(json.dumps(columns).encode(), bool)[1]
    counts = [rows.count for rows in pieces]
    assert sum(counts) == pieces.count == count
    assert max(counts) * (1 + shared + each) <= PIECE_WEIGHT + 1 + shared + each + 100


def pieces_of(columns: dict[str, Any], count: int) -> list[int]:
    """Return how many rows the pieces of a table have."""
    table = pa.table({name: pa.array(np.ones(count)) for name in BOOK if name not in columns} | columns)
    pieces = table_of(arrow_stream(table), bool)[1]
    counts = [rows.count for rows in pieces]
    assert sum(counts) == pieces.count == count
    assert min(counts) > 0
    return counts


def test_the_interrupt_is_asked_before_each_batch_of_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may have a dictionary of a million texts, which is looked at again with every one."""
    looked_at: list[int] = []
    checked = _checked
    monkeypatch.setattr(
        "app.service.batch.arrow_body._checked", lambda batch: (looked_at.append(1), checked(batch))[1]
    )
    rows = pa.record_batch({name: pa.array(cells) for name, cells in BOOK.items()})
    stream = arrow_stream(pa.Table.from_batches([rows] * 40))
    answers = iter([False] * 5 + [True] * 100)
    with pytest.raises(DeadlineError):
        table_of(stream, lambda: next(answers))
    assert len(looked_at) == 5


def test_an_answer_on_its_way_stays_counted_until_the_next_one_is() -> None:
    budget = MemoryBudget(1_000)
    work: Any = object.__new__(BatchWork)
    work._memory, work._on_its_way = HeldMemory(budget, "client"), 0
    work._answer = SimpleNamespace(add=lambda encoded, _: encoded)
    held = []

    async def sends() -> None:
        for size in (100, 30, 7):
            async for part in work._added(bytes(size), 1):
                assert len(part) == size
                held.append(budget.held)
            held.append(budget.held)

    asyncio.run(sends())
    assert held == [100, 100, 130, 30, 37, 7]


def in_dictionary(text: str, count: int) -> pa.Array:
    """Return rows that hold the same text of two."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int8)), pa.array([text, "put"]))


def test_a_choice_in_a_dictionary_counts_once_however_many_rows_hold_it() -> None:
    count = 100_000
    assert (
        len(pieces_of({"option_type": in_dictionary("x" * 16_000, count)}, count))
        <= count // PIECE_WEIGHT + 6
    )


@pytest.mark.parametrize("name", ["rate", "cash_dividends", "exercise_times", "exercise_start"])
def test_a_text_in_a_dictionary_that_each_row_reads_counts_for_each(name: str) -> None:
    columns = {"option_type": pa.array(["put"] * 1_000), name: in_dictionary("x" * 16_000, 1_000)}
    assert max(pieces_of(columns, 1_000)) * 16_000 <= 8 * PIECE_WEIGHT + 16_000


@pytest.mark.parametrize(
    ("name", "cell", "weight"), [("rate", "x" * 16_000, 2_000), ("exercise_times", [0.5] * 1_000, 1_000)]
)
def test_long_texts_and_lists_are_priced_few_at_a_time(name: str, cell: Any, weight: int) -> None:
    columns = {"option_type": pa.array(["put"] * 200), name: pa.array([cell] * 200)}
    assert max(pieces_of(columns, 200)) * weight <= PIECE_WEIGHT + weight


def test_compressed_dictionaries_are_found() -> None:
    table = pa.table({"option_type": in_dictionary("x" * 10_000, 10)})
    kinds = []
    for compression in (None, "zstd"):
        sink = pa.BufferOutputStream()
        options = pa.ipc.IpcWriteOptions(compression=compression)
        with pa.ipc.new_stream(sink, table.schema, options=options) as stream:
            stream.write_table(table)
        for message in pa.ipc.MessageReader.open_stream(pa.BufferReader(sink.getvalue())):
            kinds.append((message.type, compression, _is_compressed(memoryview(message.metadata))))
    assert [kind for kind in kinds if kind[0] == "dictionary"] == [
        ("dictionary", None, False),
        ("dictionary", "zstd", True),
    ]


@pytest.mark.parametrize("rows", [1, 10, 4_095, 4_096, 4_097, 65_536, 65_537, 200_000])
def test_pieces_hold_each_row_once(rows: int) -> None:
    counts = pieces_of({"option_type": pa.array(["put"] * rows)}, rows)
    assert max(counts) <= PIECE_WEIGHT
    assert len(counts) <= rows // PIECE_WEIGHT + rows // ROWS_AT_A_TIME + 3


def test_of_a_dictionary_what_rows_hold_is_read_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    value = arrow_column.python_value
    monkeypatch.setattr(arrow_column, "python_value", lambda cell: (read.append(cell), value(cell))[1])
    cells = pa.DictionaryArray.from_arrays(
        pa.array([1] * 5_000, pa.int16()), [f"text {k}" for k in range(4_000)]
    )
    found = ArrowColumn(FIELDS["option_type"], cells).words()
    assert found.tolist() == [-1] * 5_000
    assert len(read) == 1


def test_what_follows_an_arrow_stream_in_a_body_is_refused(client: TestClient) -> None:
    one = body_of(BOOK, ARROW)
    for body in (one + one, one + b"x", one + b"\0" * 8):
        assert_problem(ask(client, body, ARROW), 422, "invalid-arrow")


def test_columns_that_would_take_more_memory_than_there_is_are_not_parsed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All of it is counted before: what the body takes as values, and the answer while it grows."""
    book = {name: [cells[0]] * 2_000 for name, cells in BOOK.items()}
    body = body_of(book, JSON)
    parsed = []
    read = columns_of_body
    monkeypatch.setattr(
        "app.service.batch.work.columns_of", lambda *asked: (parsed.append(1), read(*asked))[1]
    )
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=len(body) + 1_000))) as client:
        problem = assert_problem(ask(client, body, JSON), 413, "body-too-large")
        assert "several parts" in problem["detail"]
        assert not parsed
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]
    enough = bytes_of_json(body) + len(body) + 1_000
    with TestClient(create_app(Settings(slots=2, max_batch_bytes=enough))) as client:
        assert_problem(ask(client, body, JSON), 413, "body-too-large")  # the answer does not fit
        assert parsed
        assert client.app.state.memory.held == 0  # type: ignore[attr-defined]
